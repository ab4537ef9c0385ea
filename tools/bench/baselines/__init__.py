"""Planners that T3DRM is measured against, all behind `interface.Baseline`."""
