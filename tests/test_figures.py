"""Pages of figures: what is not searched for stands where matplotlib would have put it."""

import pytest

from calibkit.report import figures, svg

pytestmark = pytest.mark.drawn


def two_panels(factor=1.0, *, named=True):
    """A page with titles, a legend within a panel, and values whose size decides whether their axis has a common factor."""
    figure, axes = figures.page(1, 2, title="U1 r001: bias")
    with figures.styled():
        for ax in axes:
            ax.plot([0.0, 1.0, 2.0], [0.0, 1.1 * factor, 1.9 * factor], label="bias")
            ax.set(title="gyro")
            if named:
                ax.set(xlabel="time [s]", ylabel="rate [°/h]")
        axes[0].set_title("in red", fontsize=8, color=figures.ALERT, loc="right")
        axes[1].legend(loc="best")
    return figure


@pytest.mark.parametrize(("factor", "named"), [(1.0, True), (1.0, False), (1e-7, True)])
def test_a_page_is_drawn_as_if_every_place_had_been_searched_for(monkeypatch, factor, named):
    """The same bytes with the search left out as with it, also where a factor of 1e−7 moves the title out of its way."""
    quick = figures.pdf([two_panels(factor, named=named)])
    monkeypatch.setattr(figures, "_settle", lambda figure: None)
    assert quick == figures.pdf([two_panels(factor, named=named)])


@pytest.mark.parametrize("named", [True, False])
def test_a_drawing_of_the_web_page_is_as_if_every_place_had_been_searched_for(monkeypatch, named):
    """The same SVG with the search left out before as with it."""

    def drawn():
        figure = two_panels(named=named)
        figures.pdf([figure])
        return svg.inline([figure])

    quick = drawn()
    assert "in red" in quick[0][0]
    monkeypatch.setattr(figures, "_settle", lambda figure: None)
    assert quick == drawn()
