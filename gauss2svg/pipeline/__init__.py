"""From a photo to a measured SVG: options, plan, searches and report.

    options -> Plan     with the decisions that follow from them
    photo -> Subject    as it is fitted and compared, with the canvas and document of the file
    Plan, Subject, Run -> searches, each until a file meets the plan:
        fitted scene -> Export: file, bytes and score -> corrected scene -> Export -> ..
        -> Outcome: the best file, its raster, and the costs of the fits
    outcomes -> best_of: the closest one, with the costs of all and the reason why the run stopped
    -> run_report: its measurements -> Result

These are the words of this package:

search      one way to carry out a plan: a class ByCount, ByBytes or ByAreas, whose method `run`
            returns an outcome. Pixel art needs no search
by count    a search that fits one scene, and corrects the number of Gaussians until the file meets
            the targets and limits of the user
by bytes    a search for small files that fill a limit of bytes. It fits a few scenes of few
            shapes
subject     the photo as files are compared with it, the photo as it is fitted, and the canvas of
            the file
export      a scene as it is written, with its file and the file's score
limits      the rules by which a search by count decides how many Gaussians a fit and the next
            export have, and which export is the best
outcome     the file that a search has chosen, with its measurements and the costs of all fits
goal        all targets and limits that the user gives
aim         the target of the goal: a score, and the value that the file must reach
target      the same as aim, except in a fit, where it is the image with which the fit compares its
            scene
"""
