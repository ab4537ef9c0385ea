"""Short programs that use the project; README.md lists them, and the tests run them."""
