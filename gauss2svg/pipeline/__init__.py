"""From a photo to a measured SVG: options, plan, searches and report.

    plan -> searches, each on one subject -> outcomes -> the best

A search fits, writes, rasterises, measures and corrects until a file meets the plan.

search      one way to carry out a plan. It ends with an outcome
by count    a search that fits one scene, and corrects the number of Gaussians until the file has
            the score, bytes and seconds asked for
by bytes    a search that fits a few scenes with so few shapes that every byte of the file is
            planned. A drawing may be fitted enlarged
subject     the photo as it is measured and as it is fitted, and the canvas of the file
export      a scene as it is written, with its file and the file's score
limits      rules for the count of a fit and of the next export, and for the best export
outcome     the file that a search chose, with its measurements and the costs of all fits

A *goal* has all targets and limits of the user. An *aim* is the score that the goal asks for. In
fits, a *target* is the image with which a fit compares its scene.
"""
