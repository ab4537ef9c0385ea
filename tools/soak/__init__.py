"""Mission after mission, for hours: what grows? (README.md)"""
