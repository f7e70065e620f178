"""Areas and lines of a drawing: closed paths with one paint, and strokes.

    pixels -> regions -> paints -> thin parts -> layers -> outlines -> refined -> merged -> areas

`find_areas` of gauss2svg.areas.find runs the steps in this order. Each step is a module, and takes
and returns arrays. A picture is an array (h, w, c). An opaque picture has three channels, its sRGB
values. A picture with alpha has six: its values over black, and those over white. So a transparent
pixel is a colour as any other, and errors are measured over both.
"""
