"""`python -m sparsemor`, the same program as `sparsemor`."""

from sparsemor.core.cli import main

if __name__ == "__main__":
    main()
