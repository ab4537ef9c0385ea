"""The paper: T3DRM planning, one file per element (README.md maps them)."""
