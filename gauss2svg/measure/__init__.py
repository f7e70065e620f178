"""How closely an SVG matches a photo: metrics, the round trip, any SVG."""
