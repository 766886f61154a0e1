"""Options by block pattern, as the whole scene reads them."""

from sparsemor.core.choose import chosen

__all__ = ["chosen"]
