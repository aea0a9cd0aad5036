"""The MDF tree: features per node, answers, support, images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from handeye.experiments.scenes import render
from handeye.rpt import storage
from handeye.rpt.features import cluster, find_features, left_out
from handeye.rpt.images import reduce_images
from handeye.rpt.mdf import MDFAnswer, MDFSettings, MDFTree

Floats = NDArray[np.float64]
Images = NDArray[np.uint8]

LOCAL = MDFSettings(neighbours=20, smallest=24)


def friedman(seed: int, n: int) -> tuple[Floats, Floats]:
    """Friedman's function of 5 inputs among 30 that mean nothing."""
    x = np.random.default_rng(seed).uniform(size=(n, 35))
    y = 10 * np.sin(np.pi * x[:, 0] * x[:, 1]) + 20 * (x[:, 2] - 0.5) ** 2 + 10 * x[:, 3] + 5 * x[:, 4]
    return x, y[:, np.newaxis]


def regimes(seed: int, n: int) -> tuple[Floats, Floats]:
    """In each of 4 regimes, told by input 0, another of 30 inputs makes the output."""
    rng = np.random.default_rng(seed)
    x, regime = rng.uniform(-1, 1, (n, 30)), rng.integers(0, 4, n)
    x[:, 0] = 4 * regime + 0.3 * x[:, 0]
    return x, (10 * np.sin(regime) + 3 * x[np.arange(n), 1 + regime])[:, np.newaxis]


def k_nearest(inputs: Floats, outputs: Floats, queries: Floats) -> Floats:
    """The 5 nearest on standardised inputs, weighted by 1 / distance."""
    scale = inputs.std(axis=0)
    found = []
    for query in queries:
        distances = np.linalg.norm((inputs - query) / scale, axis=1)
        near = np.argsort(distances)[:5]
        found.append(np.average(outputs[near], axis=0, weights=1 / distances[near]))
    return np.array(found)


def same(first: MDFAnswer, second: MDFAnswer) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


# --- Features --------------------------------------------------------------------------------------------------------


def test_the_discriminating_direction_is_fishers() -> None:
    rng = np.random.default_rng(1)
    mixing = rng.normal(size=(4, 4))
    labels = np.arange(2000) % 2
    points = rng.normal(size=(2000, 4)) @ mixing.T
    shift = np.array([1.0, -2.0, 0.5, 1.0])
    points[labels == 1] += shift
    fisher = np.linalg.solve(mixing @ mixing.T, shift)
    found = find_features(points, np.eye(2)[labels], np.arange(2000), classes=True)
    assert found.directions.shape == (4, 1)
    cosine = abs(found.directions[:, 0] @ fisher) / np.linalg.norm(found.directions) / np.linalg.norm(fisher)
    assert cosine > 0.98


def test_more_components_than_samples_give_the_same_features_as_components_without_meaning_added() -> None:
    """The n x n and the d x d way to principal components agree."""
    rng = np.random.default_rng(2)
    points, outputs = rng.normal(size=(40, 6)), rng.normal(size=(40, 1))
    outputs += points[:, :1] * 5
    padded = np.hstack([points, np.zeros((40, 60))])
    narrow = find_features(points, outputs, np.arange(40), classes=False)
    wide = find_features(padded, outputs, np.arange(40), classes=False)
    np.testing.assert_allclose(wide.project(padded), narrow.project(points), atol=1e-8)


def test_a_symmetric_term_is_seen_by_its_spread() -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (600, 10))
    found = find_features(points, points[:, 4:5] ** 2, np.arange(600), classes=False)
    direction = np.abs(found.directions[:, 0]) / np.linalg.norm(found.directions[:, 0])
    assert direction[4] > 0.9


def test_left_out_residuals_are_those_of_fits_without_the_group() -> None:
    rng = np.random.default_rng(4)
    points, outputs, groups = rng.normal(size=(20, 3)), rng.normal(size=(20, 2)), np.arange(20) // 4
    left = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[0]
    found = left_out(left, np.ones(3), outputs - outputs.mean(axis=0), groups)
    for group in range(5):
        inside = groups == group
        design = np.column_stack([np.ones(20), points])
        fit = np.linalg.lstsq(design[~inside], outputs[~inside], rcond=None)[0]
        np.testing.assert_allclose(found[inside], outputs[inside] - design[inside] @ fit, atol=1e-6)


def test_clusters_are_those_of_the_outputs() -> None:
    centres = np.array([[0.0, 0], [10, 0], [0, 10]])
    outputs = np.repeat(centres, 5, axis=0) + np.random.default_rng(5).normal(0, 0.1, (15, 2))
    labels = cluster(outputs, 3)
    assert [len(set(labels[i : i + 5])) for i in (0, 5, 10)] == [1, 1, 1]
    assert len(set(labels)) == 3
    assert set(cluster(np.ones((4, 2)), 3)) == {0}


# --- Answers ---------------------------------------------------------------------------------------------------------


def test_inputs_without_meaning_matter_little() -> None:
    """Seeds neither of the tuning nor of the report; with 1000 samples the ratio is below 0.55."""
    inputs, outputs = friedman(3, 600)
    queries, truth = friedman(4, 150)
    answer = MDFTree.fit(inputs, outputs).answer(queries)
    ours, theirs = (np.abs(found - truth).mean() for found in (answer.output, k_nearest(inputs, outputs, queries)))
    assert ours < 0.7 * theirs


def test_nodes_have_features_of_their_own() -> None:
    inputs, outputs = regimes(1, 800)
    queries, truth = regimes(2, 100)
    tree = MDFTree.fit(inputs, outputs, settings=LOCAL)
    owners = [node for node in tree.nodes if node.features is not None]
    assert len(owners) > 1
    for node in owners[1:]:
        root, own = tree.nodes[0].features, node.features
        assert root is not None
        assert own is not None
        # Where the root looks is not where the node looks.
        overlap = np.linalg.qr(root.directions)[0].T @ np.linalg.qr(own.directions)[0]
        assert np.linalg.norm(overlap, axis=0).min() < 0.9
    whole = MDFTree.fit(inputs, outputs, settings=MDFSettings(neighbours=20, smallest=10_000))
    errors = [np.abs(each.answer(queries).output - truth).mean() for each in (tree, whole)]
    assert len(whole.nodes) == 1
    assert errors[0] < errors[1]


def test_the_tree_keeps_the_rules_of_the_rpt() -> None:
    inputs, outputs = regimes(1, 800)
    tree = MDFTree.fit(inputs, outputs, settings=LOCAL)
    divided = [node for node in tree.nodes if node.children]
    assert divided
    for node in divided:
        children = [tree.nodes[child] for child in node.children]
        assert len(children) <= LOCAL.fan_out
        assert sorted(np.concatenate([child.members for child in children])) == sorted(node.members)
        centres = node.places[np.searchsorted(node.members, [child.sample for child in children])]
        gaps = np.linalg.norm(centres[:, np.newaxis] - centres, axis=2)
        assert (gaps + np.diag(np.full(len(children), np.inf))).min() > node.radius
        for number, child in enumerate(children):
            places = node.places[np.isin(node.members, child.members)]
            assert (np.linalg.norm(places[:, np.newaxis] - centres, axis=2).argmin(axis=1) == number).all()


def test_a_beam_as_wide_as_the_tree_finds_the_nearest_of_the_answering_node() -> None:
    inputs, outputs = regimes(1, 800)
    wide = MDFSettings(neighbours=20, smallest=24, beam_width=1000)
    tree = MDFTree.fit(inputs, outputs, settings=wide)
    owners = [node for node in tree.nodes if node.features is not None]
    for query in regimes(2, 10)[0]:
        answer = tree.answer(query)
        brute = []
        for node in owners:
            assert node.features is not None
            place = node.features.project((query - inputs.mean(axis=0)) / inputs.std(axis=0))
            distances = np.linalg.norm(node.places - place, axis=1)
            brute.append(node.members[np.argsort(distances, kind="stable")[:20]].tolist())
        assert answer.ids.tolist() in brute


def test_a_taught_input_finds_itself() -> None:
    inputs, outputs = regimes(1, 400)
    answer = MDFTree.fit(inputs, outputs, settings=LOCAL).answer(inputs[:50])
    assert answer.ids[:, 0].tolist() == list(range(50))
    assert answer.distances[:, 0] == pytest.approx(0, abs=1e-9)
    assert answer.weights.sum(axis=1) == pytest.approx(1)


def test_classes() -> None:
    rng = np.random.default_rng(6)
    names = np.array(["cup", "gripper", "table"])[rng.integers(0, 3, 240)]
    inputs = rng.normal(0, 1, (240, 20))
    inputs[:, 3] += 6 * (names == "cup")
    inputs[:, 7] += 6 * (names == "gripper")
    tree = MDFTree.fit(inputs[:160], labels=names[:160])
    assert tree.nodes[0].places.shape == (160, 2)
    assert (tree.answer(inputs[160:]).output == names[160:]).mean() > 0.95
    assert str(tree.answer(inputs[0]).output) == names[0]


@pytest.mark.parametrize("labels", [None, ["one"] * 6])
def test_coincident_inputs(labels: list[str] | None) -> None:
    outputs = None if labels else np.arange(6.0)
    answer = MDFTree.fit(np.full((6, 4), 0.1), outputs, labels=labels).answer(np.full(4, 0.1))
    assert answer.output == ("one" if labels else pytest.approx(2.5))
    assert answer.ids.tolist() == list(range(6))
    assert answer.support == 1


def test_constant_outputs_and_a_single_sample() -> None:
    inputs = np.random.default_rng(7).normal(size=(90, 5))
    answer = MDFTree.fit(inputs, np.full((90, 2), 0.1)).answer(inputs[:4] + 0.3)
    assert answer.output == pytest.approx(0.1)
    alone = MDFTree.fit(inputs[:1], [[1.0, 2.0]]).answer(inputs[1])
    assert alone.output.tolist() == [1.0, 2.0]
    assert alone.support == 1
    two = MDFTree.fit(inputs[:2], [1.0, 2.0]).answer(inputs[:2])
    assert two.ids[:, 0].tolist() == [0, 1]


def test_one_query_is_answered_as_among_several() -> None:
    inputs, outputs = regimes(1, 200)
    tree = MDFTree.fit(inputs, outputs, settings=LOCAL)
    several = tree.answer(inputs[:3] + 0.1)
    for i in range(3):
        assert same(tree.answer(inputs[i] + 0.1), MDFAnswer(*(part[i] for part in several)))


def test_the_same_samples_give_the_same_tree_and_a_file_brings_it_back(tmp_path: Path) -> None:
    inputs, outputs = regimes(1, 800)
    names = np.where(outputs[:, 0] > 0, "up", "down")
    images, places = render(1, 12, shape=(48, 64))
    trees: list[tuple[MDFTree, MDFTree, Any]] = [
        (MDFTree.fit(inputs, outputs, settings=LOCAL), MDFTree.fit(inputs, outputs, settings=LOCAL), inputs[:9] + 0.1),
        (MDFTree.fit(inputs, labels=names), MDFTree.fit(inputs, labels=names), inputs[:9] + 0.1),
        (MDFTree.fit(images, places), MDFTree.fit(images, places), images[:3]),
    ]
    for tree, again, queries in trees:
        values, arrays = tree.to_state()
        assert values == again.to_state()[0]
        assert all(np.array_equal(part, again.to_state()[1][name]) for name, part in arrays.items())
        storage.save(tree, tmp_path / "tree.rpt")
        back = storage.load(tmp_path / "tree.rpt", MDFTree)
        assert back.settings == tree.settings
        assert same(back.answer(queries), tree.answer(queries))
    with pytest.raises(storage.StorageError, match="holds 'mdf', not 'model'"):
        storage.load(tmp_path / "tree.rpt")


def test_parts_that_do_not_fit_are_refused() -> None:
    values, arrays = MDFTree.fit(*regimes(1, 400), settings=LOCAL).to_state()
    with pytest.raises(KeyError, match="scores"):
        MDFTree.from_state(values, {name: part for name, part in arrays.items() if name != "scores"})
    for name, damaged in (
        ("0.members", arrays["0.members"] + 1),
        ("0.places", arrays["0.places"][1:]),
        ("nodes", arrays["nodes"] + [[0, 0, 0, 5]]),
        ("0.children", np.array([0])),
        ("nodes", arrays["nodes"][:0]),
    ):
        with pytest.raises(ValueError, match="node"):
            MDFTree.from_state(values, arrays | {name: damaged})


# --- Support ---------------------------------------------------------------------------------------------------------


def test_support_is_rarely_small_for_queries_like_the_taught_ones_and_small_outside() -> None:
    inputs, outputs = regimes(1, 400)
    tree = MDFTree.fit(inputs, outputs)
    queries = regimes(2, 200)[0]
    assert (tree.answer(queries).support <= 0.1).mean() <= 0.15
    # Inputs that the features do not look at count as well.
    queries[:, 20:] *= 10
    assert (tree.answer(queries[:50]).support <= 0.01).all()


def test_demonstrations_are_left_out_as_wholes() -> None:
    """Samples of one demonstration are alike; a new demonstration is no alarm if whole ones were left out."""
    rng = np.random.default_rng(8)

    def demonstrations(count: int) -> Floats:
        return np.repeat(rng.normal(size=(count, 6)), 10, axis=0) + rng.normal(0, 0.01, (count * 10, 6))

    inputs, groups = demonstrations(24), np.arange(240) // 10
    outputs, queries = inputs[:, :1], demonstrations(15)
    alone = MDFTree.fit(inputs, outputs).answer(queries).support
    wholes = MDFTree.fit(inputs, outputs, groups=groups).answer(queries).support
    assert (alone <= 0.05).mean() > 0.5
    assert (wholes <= 0.05).mean() <= 0.2


# --- Images ----------------------------------------------------------------------------------------------------------


def test_block_means_do_not_know_brightness_and_contrast() -> None:
    images = np.random.default_rng(9).integers(0, 100, (3, 50, 70), dtype=np.uint8)
    reduced = reduce_images(images, 20)
    assert reduced.shape == (3, 13 * 18)  # blocks of 4 x 4 pixels, cut off at the edges
    np.testing.assert_allclose(reduce_images(images * 2 + 7, 20), reduced, atol=1e-12)
    first = images[0, :4, :4].mean(), images[0, 48:, 68:].mean()
    blocks = reduced[0, [0, -1]]
    assert np.sign(blocks[1] - blocks[0]) == np.sign(first[1] - first[0])
    assert reduce_images(np.full((1, 480, 640), 255, np.uint8), 20).tolist() == [[0.0] * 300]


def test_an_object_is_found_in_images() -> None:
    """640 x 480 pixels, a distractor larger than the object; k-NN on the same reduced images looks at that."""
    images, places = render(1, 160)
    queries, truth = render(2, 25)
    tree = MDFTree.fit(images, places)
    answer = tree.answer(queries)
    errors = np.linalg.norm(answer.output - truth, axis=1)
    reduced, asked = reduce_images(images, 20), reduce_images(queries, 20)
    theirs = np.linalg.norm(k_nearest(reduced, places, asked) - truth, axis=1)
    assert errors.mean() < 0.5 * theirs.mean()
    assert (answer.support <= 0.05).mean() <= 0.2
    assert (tree.answer(render(3, 8, world=5)[0]).support <= 0.05).all()
    found = tree.answer(images[7])
    assert found.ids[0] == 7
    # Beside the images only their means and the features are kept.
    assert sum(part.nbytes for part in tree.to_state()[1].values()) < 4e6


def test_identical_images() -> None:
    image = render(1, 1, shape=(48, 64))[0]
    answer = MDFTree.fit(np.repeat(image, 5, axis=0), np.full((5, 2), 3.0)).answer(image[0])
    assert answer.output == pytest.approx(3)
    assert answer.ids.tolist() == [0, 1, 2, 3, 4]


# --- What is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inputs", "known", "sentence"),
    [
        (np.empty((0, 3)), {"outputs": np.empty((0, 1))}, "non-empty"),
        (np.ones((3, 2)), {"outputs": [1.0, np.nan, 2.0]}, "outputs must be finite"),
        ([[np.inf, 1.0]], {"outputs": [1.0]}, "inputs must be finite"),
        (np.ones((3, 2)), {"outputs": [1.0, 2.0]}, "each input needs"),
        (np.ones((3, 2)), {"outputs": np.ones((3, 1, 1))}, "outputs must be"),
        (np.ones((3, 2)), {}, "either outputs or labels"),
        (np.ones((3, 2)), {"outputs": [1, 2, 3], "labels": [1, 2, 3]}, "either outputs or labels"),
        (np.ones((3, 2)), {"labels": [1.5, 2.0, 3.0]}, "labels must be"),
        (np.ones((3, 2)), {"outputs": [1, 2, 3], "groups": [1, 2]}, "each input needs"),
        (np.ones((3, 2)), {"outputs": [1, 2, 3], "groups": [1.0, 2.0, 3.0]}, "each input needs"),
        (np.ones((3, 4, 5)), {"outputs": [1, 2, 3]}, "8-bit"),
        (np.ones((3, 0, 5), np.uint8), {"outputs": [1, 2, 3]}, "non-empty"),
        (np.ones((3, 2, 2, 2), np.uint8), {"outputs": [1, 2, 3]}, "inputs must be"),
    ],
)
def test_what_does_not_fit_is_refused(inputs: Any, known: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        MDFTree.fit(inputs, **known)


@pytest.mark.parametrize(
    "wrong",
    [
        {"neighbours": 0}, {"voters": 0}, {"beam_width": 0}, {"fan_out": 1}, {"smallest": 3}, {"cells": 0},
        {"smoothing": 0.0}, {"ridge": np.inf},
    ],
)  # fmt: skip
def test_settings_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        MDFSettings(**wrong)


def test_images_of_another_kind_are_refused() -> None:
    images, places = render(1, 6, shape=(48, 64))
    tree = MDFTree.fit(images, places)
    for wrong, sentence in ((images[:, 1:], "48 x 64"), (images / 2, "8-bit"), (images[0, 0], "images must be")):
        with pytest.raises(ValueError, match=sentence):
            tree.answer(wrong)


@given(
    rows=st.lists(st.lists(st.floats(width=64), min_size=1, max_size=3), max_size=4),
    outputs=st.lists(st.floats(-1e6, 1e6), max_size=4),
)
@settings(deadline=None, max_examples=60)
def test_any_input_is_answered_or_refused(rows: list[list[float]], outputs: list[float]) -> None:
    try:
        tree = MDFTree.fit(rows, outputs)
    except ValueError:
        return
    answer = tree.answer(rows)
    assert np.isfinite(answer.output).all()
    assert ((answer.support > 0) & (answer.support <= 1)).all()
    assert (answer.ids >= 0).all()
