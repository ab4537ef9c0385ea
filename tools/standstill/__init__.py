"""From a fault of the computer to a vehicle that stands: measured, as a table (README.md)."""
