"""Flights among movers: who is hit, by whom, and whether it could have been avoided."""
