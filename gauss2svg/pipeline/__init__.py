"""From a photo to a measured SVG: options, plan, searches and report.

    plan -> searches, each on one subject -> outcomes -> the best

A search fits a scene, writes it as a file, rasterises and measures the file, and corrects the
scene, until a file meets the plan. These are the words of this package:

search      one way to carry out a plan. It ends with an outcome
by count    a search that fits one scene, and corrects the number of Gaussians until the file meets
            the targets and limits of the user
by bytes    a search for small files that fill a limit of bytes. It fits a few scenes of few
            shapes
subject     the photo as files are compared with it, the photo as it is fitted, and the canvas of
            the file
export      a scene as it is written, with its file and the file's score
limits      the rules that decide how many Gaussians a fit and the next export have, and which
            export is the best
outcome     the file that a search has chosen, with its measurements and the costs of all fits
goal        all targets and limits that the user gives
aim         the target of the goal: a score, and the value that the file must reach
target      the same as aim, except in a fit, where it is the image with which the fit compares its
            scene
"""
