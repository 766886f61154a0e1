from sparsemor_sample import EveryNth

from sparsemor.core.testing import check_sampler


def test_laws() -> None:
    check_sampler(EveryNth())
