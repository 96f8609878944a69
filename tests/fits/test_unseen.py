"""Errors against their stated uncertainty: false alarms as stated, and errors that are shared."""

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.fit import unseen


@pytest.mark.parametrize("shared_u", [0.0, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("size", [3, 40])
def test_errors_as_large_as_stated_seldom_fail(monkeypatch, shared_u, size):
    """At a chance of 1 in 20 errors of two shared patterns and noise fail in 2 to 8 of 100."""
    monkeypatch.setattr(unseen, "FALSE_ALARM", 0.05)
    monkeypatch.setattr(unseen, "TOLERATED", 0.0)
    generator = np.random.default_rng(7)
    shared = shared_u * np.column_stack([np.ones(size), np.linspace(-1.0, 1.0, size)])
    own = generator.uniform(0.5, 2.0, size)
    failed = 0
    for _ in range(2000):
        error = shared @ generator.standard_normal(2)
        error += np.sqrt(own) * generator.standard_normal(size)
        found = unseen.unseen(error, shared, own)
        failed += found.ratio > found.limit
    assert 0.02 * 2000 < failed < 0.08 * 2000


def test_one_error_is_judged_as_one_normal_number():
    """The limit for a single error is the normal quantile of the stated chance, 3.29."""
    found = unseen.unseen(np.array([5.0]), np.array([[3.0]]), np.array([16.0]))
    assert found.ratio == pytest.approx(1.0)
    assert found.limit == pytest.approx(3.2905, abs=1e-4)


def test_few_degrees_of_freedom_of_u_widen_the_limit():
    """With 5 degrees of freedom of u the limit for one error is Student's, 6.869; of the part that
    dominates, whichever that is.
    """
    one, none = np.ones((1, 1)), np.zeros((1, 1))
    shared = unseen.unseen(np.ones(1), one, np.zeros(1), dof=(5.0, np.inf))
    own = unseen.unseen(np.ones(1), none, np.ones(1), dof=(1.0, 5.0))
    assert shared.limit == pytest.approx(6.8688, abs=1e-3)
    assert own.limit == pytest.approx(6.8688, abs=1e-3)


def test_an_error_without_an_uncertainty_is_refused():
    """Nothing can be judged against an uncertainty of 0."""
    with pytest.raises(FitError, match="without an uncertainty"):
        unseen.unseen(np.ones(2), np.zeros((2, 1)), np.array([1.0, 0.0]))
