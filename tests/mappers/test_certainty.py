"""What a Hilbert Map says of itself: what scans would see at all, what it shows of that, and how far its grids disagree."""

import numpy as np
import pytest

from hilbertvae.grids.kernel import kernel


def test_what_would_be_known(fitted):
    """1 where it is, 0 where no grid reaches, and between them what the network says, if it does."""
    mapper, place = fitted
    low, high = mapper.frames_.boxes()
    queries = np.random.default_rng(0).uniform(low.min(axis=0) - 2, high.max(axis=0) + 2, (400, place.dimension))
    found, observed = mapper.known(queries), mapper.observed(queries)
    reached = np.array([((query >= low) & (query < high)).all(axis=1).any() for query in queries])
    assert (found[observed] == 1).all() and (found[~observed & ~reached] == 0).all()
    between = found[~observed & reached]
    assert len(between) and ((between > 0) & (between < 1)).all() if mapper.known_ is not None else (between == 1).all()
    if mapper.known_ is None:
        return
    holding = mapper.index_.holding(queries, mapper.neighbours)
    for query, boxes, one in zip(queries[~observed], holding[~observed], found[~observed], strict=True):
        in_each = [(m, (query - low[m]) / (high[m] - low[m]) * mapper.grid_.cells) for m in boxes[boxes >= 0]]
        said = [mapper.known_[(m, *inside.astype(int))] / 255 for m, inside in in_each]
        assert one == pytest.approx(np.mean(said) if said else 0.0, abs=1e-6)


def test_a_map_shows_nothing_where_no_scan_would_see(fitted):
    mapper, place = fitted
    low, high = mapper.frames_.boxes()
    queries = np.random.default_rng(2).uniform(low.min(axis=0) - 1, high.max(axis=0) + 1, (300, place.dimension))
    shown, plain, known = mapper.predict_map(queries), mapper.predict_proba(queries)[:, 1], mapper.known(queries)
    full = {2: 0.5, 3: 0.1}[place.dimension]
    np.testing.assert_array_equal(shown[known >= full], plain[known >= full])
    np.testing.assert_array_equal(shown[known == 0], 0.5)
    np.testing.assert_allclose(shown - 0.5, (plain - 0.5) * np.minimum(known / full, 1), atol=1e-6)


def test_the_spread_is_that_of_what_each_grid_alone_would_answer(fitted):
    mapper, place = fitted
    low, high = place.fit.points.min(axis=0) - 1, place.fit.points.max(axis=0) + 1
    queries = np.random.default_rng(1).uniform(low, high, (60, place.dimension))
    found, holding = mapper.predict_std(queries), mapper.index_.holding(queries, mapper.neighbours)
    observed = mapper.observed(queries)
    for q, query in enumerate(queries):
        boxes = holding[q][holding[q] >= 0]
        if not len(boxes):
            assert found[q] == (0 if observed[q] else 0.5)
            continue
        said = []
        for box in boxes:  # a map in which all of these boxes hold this one's grid
            grids = np.array([mapper.grids_[m] for m in range(len(mapper.grids_))]).astype(float)
            value = kernel(grids, mapper.frames_, query[None], np.array([[box]]))[0, 0]
            value *= 1.0 if mapper.factors_ is None else mapper.factors_[box]
            features = list(mapper.features(query[None]))
            features[0] = np.where(np.arange(mapper.neighbours) < len(boxes), value, 0.0)[None]
            said.append(1 / (1 + np.exp(-mapper.rank_weights_.logit(*features)[0])))
        assert found[q] == pytest.approx(np.std(said), abs=1e-4)
    assert found[~observed & (holding[:, 1] >= 0)].max() > 0.001 or mapper.reconstructor is None


def test_one_look_says_all_that_three_questions_do(fitted):
    mapper, place = fitted
    low, high = mapper.frames_.boxes()
    queries = np.random.default_rng(3).uniform(low.min(axis=0) - 2, high.max(axis=0) + 2, (300, place.dimension))
    expected = mapper.predict_map(queries), mapper.predict_std(queries), mapper.observed(queries)
    for chunk in (7, 1000):
        mapper.chunk = chunk
        for found, wanted in zip(mapper.describe(queries), expected, strict=True):
            np.testing.assert_array_equal(found, wanted)
    mapper.chunk = type(mapper).chunk
    assert all(len(found) == 0 for found in mapper.describe(queries[:0]))
