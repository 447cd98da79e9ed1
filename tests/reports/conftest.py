"""Fixtures of the tests of reports."""

import pytest

from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reports.site_view import SiteView
from toy_places import street, street_gaps


@pytest.fixture(scope="module")
def view():
    """A street with gaps, and what a mapper says of it."""
    site, gaps = street(), street_gaps()
    shown = gaps.cut(site.fit)
    return SiteView.draw(site, gaps, shown, NearestMapper(1).fit(shown.points, shown.occupied))
