"""The public names and their modules, which `gauss2svg` loads on first use."""

from . import studio as studio
from .batch.many import vectorize_many as vectorize_many
from .batch.many import PhotoRecord as PhotoRecord
from .compare.pages import build_gallery as build_gallery
from .compare.pages import GalleryOptions as GalleryOptions
from .errors import (
    Gauss2SvgError as Gauss2SvgError,
    InputError as InputError,
    OutputError as OutputError,
    RendererError as RendererError,
    SceneError as SceneError,
)
from .fit import FitOptions as FitOptions
from .measure.check import CheckResult as CheckResult, check as check
from .pipeline.options import (
    Goal as Goal,
    Options as Options,
    RunOptions as RunOptions,
    SvgOptions as SvgOptions,
)
from .pipeline.placeholder import Placeholder as Placeholder, placeholder as placeholder
from .pipeline.palette import quantize as quantize
from .pipeline.vectorize import Result as Result
from .pipeline.options import Progress as Progress
from .pipeline.vectorize import vectorize as vectorize
from .scene.areas import (
    Area as Area,
    LinearGradient as LinearGradient,
    Outline as Outline,
    RadialGradient as RadialGradient,
)
from .svg import Document as Document, Plotter as Plotter, SvgFormat as SvgFormat
from .scene.scene import Scene as Scene
from .svg.read import read_svg as read_svg
from .svg.encode import outline_svg as outline_svg
from .svg.write import plate_svg as plate_svg, write_svg as write_svg
from .version import __version__ as __version__
