"""When to do what: the machine, preflight, failsafe and the pilot (Algorithm 2)."""
