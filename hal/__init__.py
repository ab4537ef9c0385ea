"""What the hardware can do: sensors and vehicles behind one contract (`hal.interfaces`)."""
