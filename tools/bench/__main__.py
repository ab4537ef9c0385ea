"""`make bench`: the flights in process, as a table. See tools/bench/README.md."""

from tools.bench.flights import main

if __name__ == "__main__":
    main()
