"""Ranges to obstacles and seen-free space."""
