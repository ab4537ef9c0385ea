"""What the drone decides: estimation, perception, T3DRM planning, guidance and the mission."""

__version__ = "0.1.0"
