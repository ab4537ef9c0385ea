"""How good the estimator is: consistency and errors over Monte Carlo runs."""
