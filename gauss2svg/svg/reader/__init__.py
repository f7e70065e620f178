"""Reading SVGs of ours, also as Inkscape saves them."""
