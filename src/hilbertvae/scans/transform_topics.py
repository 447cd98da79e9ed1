"""Which topic of transforms says where a frame was, where a bag has several: of two robots whose frames have the same names, or of a node
that was renamed so that another takes its place."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Sequence

from hilbertvae.scans.bag_poses import nanoseconds
from hilbertvae.scans.transform_tree import Sources, TransformTree

PLAIN = ("tf", "tf_static")
"""What tf2 calls its topics, in any namespace."""


class TransformTopics:
    """The transforms of each topic by themselves, until all are known."""

    def __init__(self):
        self._trees: dict[bool, dict[str, TransformTree]] = {False: {}, True: {}}
        """By whether it is a topic of static ones, and by topic."""

    def add(self, topic: str, transforms: Iterable) -> None:
        """The transforms of one message; those of `tf_static`, in any namespace, hold at all times."""
        static = _split(topic)[-1].startswith("tf_static")
        tree = self._trees[static].setdefault(topic, TransformTree())
        for each in transforms:
            header, move = each.header, each.transform
            tree.add(header.frame_id, each.child_frame_id, nanoseconds(header.stamp), move.translation, move.rotation, static)

    def tree(self, scan_topic: str) -> TransformTree:
        """Each frame as one topic has it, static and moving ones apart: where topics differ, as that of `topic_beside` does.

        Where none stands out, the frame is an `InputError` once a pose goes by it. A topic of another namespace that is passed over for one
        frame is so for all: it is another robot's.
        """
        whole = TransformTree()
        for static, trees in self._trees.items():
            by_child: dict[str, list[str]] = defaultdict(list)
            for topic, tree in trees.items():
                for child in tree.children:
                    by_child[child].append(topic)
            found = {child: _sources(child, topics, trees, scan_topic) for child, topics in by_child.items()}
            strangers = {topic for each in found.values() if each.kept for topic in each.others if not _is_above(topic, scan_topic)}
            for topic, tree in trees.items():
                mine = {child for child, each in found.items() if topic in ([each.kept] if each.kept else each.others)}
                whole.take(tree, mine if topic not in strangers else set())
            whole.sources |= {(static, child): each for child, each in found.items() if each.others}
        return whole


def topic_beside(topics: Sequence[str], scan_topic: str) -> str | None:
    """The one of several topics of transforms that is a sensor's own robot's: of those whose namespace the sensor's is in the innermost,
    and of several there the one that has tf2's name; else the one whose namespace begins as the sensor's does longest. None where no one
    stands out."""
    home = _split(scan_topic)[:-1]
    shared = {topic: len(os.path.commonprefix([home, _split(topic)[:-1]])) for topic in topics}
    above = [topic for topic in topics if _is_above(topic, scan_topic)]
    most = max(shared[topic] for topic in above or topics)
    best = [topic for topic in above or topics if shared[topic] == most]
    if above:
        best = [topic for topic in best if _split(topic)[-1] in PLAIN] or best
    return best[0] if len(best) == 1 and (above or most) else None


def _sources(child: str, topics: list[str], trees: dict[str, TransformTree], scan_topic: str) -> Sources:
    kept = topic_beside(topics, scan_topic)
    first = kept or topics[0]
    unlike = [topic for topic in topics if topic != first and not trees[first].agrees(trees[topic], child)]
    if kept or not unlike:
        return Sources(first, tuple(sorted(unlike)))
    return Sources(None, tuple(sorted(topics)))


def _is_above(topic: str, scan_topic: str) -> bool:
    """Whether a sensor is in a topic's namespace."""
    space = _split(topic)[:-1]
    return _split(scan_topic)[: len(space)] == space


def _split(topic: str) -> list[str]:
    return topic.strip("/").split("/")
