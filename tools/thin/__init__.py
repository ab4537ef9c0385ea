"""How thin an obstacle may be before the flight touches it."""
