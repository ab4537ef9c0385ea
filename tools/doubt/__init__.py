"""How well beams are doubted: simulated flights with and without a fault of one sensor."""
