"""Names of the model, which `gauss2svg.scene` loads on first use."""

from .areas import (
    Area as Area,
    LinearGradient as LinearGradient,
    Outline as Outline,
    RadialGradient as RadialGradient,
)
from .scene import (
    ABOVE as ABOVE,
    BLURRED as BLURRED,
    LEAST_CANVAS as LEAST_CANVAS,
    LEAST_SIGMA as LEAST_SIGMA,
    MOST_CANVAS as MOST_CANVAS,
    MOST_MEAN as MOST_MEAN,
    MOST_SIGMA as MOST_SIGMA,
    MOST_SIGNED as MOST_SIGNED,
    PLAIN as PLAIN,
    RHO_LIMIT as RHO_LIMIT,
    SOFT as SOFT,
)
from .scene import (
    Scene as Scene,
    narrowing_of as narrowing_of,
    whitening_of as whitening_of,
)

OVER: str
ADD: str
BLENDS: tuple[str, str]
