import pytest
import torch

from stages.train.objective import SMOOTH_M, drift_m

SIDE = torch.tensor([-1.0] * 40 + [0.0] * 20 + [1.0] * 40)


def test_a_common_error_counts_in_full():
    shift = torch.tensor([0.0, 0.0, -2e-4]).expand(100, 3)
    assert float(drift_m(shift, SIDE)) == pytest.approx(2e-4, abs=SMOOTH_M)


def test_trembling_does_not_count():
    shift = 1e-4 * torch.randn(50, 3, generator=torch.Generator().manual_seed(0))
    assert float(drift_m(torch.cat([shift, -shift]), torch.zeros(100))) == pytest.approx(SMOOTH_M)


def test_halves_that_err_in_opposite_directions_do_not_cancel():
    shift = SIDE[:, None] * torch.tensor([1e-3, 0.0, 0.0])
    assert float(drift_m(shift, SIDE)) == pytest.approx(0.8e-3, abs=SMOOTH_M)


def test_its_gradient_pulls_everything_back_alike():
    shift = torch.full((100, 3), 1e-3).requires_grad_()
    drift_m(shift, SIDE).backward()
    assert shift.grad is not None
    assert float(shift.grad.std()) < 1e-6 and float(shift.grad.sum()) == pytest.approx(3**0.5, rel=1e-3)
