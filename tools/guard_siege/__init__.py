"""The guard under siege: adversarial setpoints and worlds, judged by a worst-case vehicle."""
