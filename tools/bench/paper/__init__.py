"""The paper's Tables 4 to 7 as experiments, on reconstructions of its five scenarios."""
