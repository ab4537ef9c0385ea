"""The documents shipped with the program; installed as the package `autonomy_configs`.

`importlib.resources.files("autonomy_configs")` finds them in a checkout and in an installation.
"""
