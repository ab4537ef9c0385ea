"""Range sensors."""
