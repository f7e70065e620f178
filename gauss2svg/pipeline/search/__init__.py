"""Searches: fit, write, rasterise, measure, correct, until a file is what the plan asks for.

    plan -> searches, each on one subject -> outcomes -> the best

search      one way to carry out a plan; it runs to an outcome
by count    fits the usual scene, and corrects the number of Gaussians until the file has the score,
            bytes and seconds asked for
by bytes    fits a few scenes of so few shapes that every byte of the file is planned
drawing     a search by bytes for a drawing, which is fitted enlarged
subject     the photo that is drawn: as it is measured, as it is fitted, and the canvas of the file
export      a scene as it is written: its file, and what that scores
limits      how many Gaussians a fit may have, by what they gain, take and cost; how many the next
            export has; and which export is the best
cap         the largest count that is allowed, and what allows no more
outcome     the export that a search ends with, measured, with the costs of its fits

A *goal* is what the user asks for, an *aim* the score that it asks for; a *target* is an image that
a fit compares with.
"""
