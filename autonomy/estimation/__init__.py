"""Readings to fused state."""
