"""Graph states: what is reachable from a root, as octets and back, and what is refused."""

from collections import OrderedDict, deque
from random import Random

import msgpack
import pytest

from rmr.base.geometry import Point
from rmr.base.streams import Choices
from rmr.base.values import Robot, Symbol
from rmr.mind.graph_restoration import GeneratedFunctions, GraphMismatchError
from rmr.mind.mind_versions import is_compiled
from rmr.mind.object_graph import Skeleton, UnsavedError
from rmr.node.actions.handle import Pause
from rmr.node.trace import TraceLevel

pytestmark = pytest.mark.skipif(is_compiled(), reason="where rmr is compiled there are no snapshots")


class Root:
    """What the tests save: a class of rmr by its module."""

    __module__ = "rmr.tests"

    def __init__(self):
        self.rng = Random(1)
        self.queue = deque([1, 2], maxlen=3)
        self.known = {}
        self.ordered = OrderedDict(a=1)
        self.numbers = {3, 1}
        self.draws = Choices("draws")
        self.call = self.double
        self.later = lambda: self.known

    def double(self):
        """Return twice the first of the queue."""
        return 2 * self.queue[0]


def skeleton(root):
    return Skeleton(root, (), (), GeneratedFunctions(root))


def restored(change):
    """Change a root, and return another one with its state, and both skeletons."""
    first, second = Root(), Root()
    one, other = skeleton(first), skeleton(second)
    change(first)
    other.restore(one.state())
    assert other.state() == one.state()
    return first, second


def test_contents_of_all_kinds_come_back_into_the_objects_that_are_there():
    def change(root):
        root.rng.random()
        root.queue.append(Symbol("spot"))
        root.known.update({Robot(3): [(1, -0.0, 1 << 70)], "level": TraceLevel.FACTS, (1, 2): Point(1.0, 2.0)})
        root.ordered.move_to_end("a")
        root.ordered["b"] = frozenset([2, 1])
        root.numbers.discard(3)
        root.draws.below(10)
        root.pause = Pause(7, root.double)

    first, second = restored(change)
    assert second.rng.random() == first.rng.random()
    assert list(second.queue) == [1, 2, "spot"]
    assert type(second.queue[2]) is Symbol
    assert second.queue.maxlen == 3
    assert second.known == first.known
    assert [type(key) for key in second.known] == [Robot, str, tuple]
    assert second.draws.state == first.draws.state
    assert list(second.ordered.items()) == [("a", 1), ("b", frozenset([1, 2]))]
    assert second.pause.condition.__self__ is second
    assert second.pause.over(7)
    assert second.later() is second.known, "a closure is that of the new root, over its objects"


def test_objects_that_are_one_stay_one_and_circles_are_closed():
    def change(root):
        shared = [1]
        root.known["one"] = shared
        root.known["other"] = [shared, root.known]

    _, second = restored(change)
    assert second.known["other"][0] is second.known["one"]
    assert second.known["other"][1] is second.known


def test_an_unchanged_root_has_an_empty_state():
    root = Root()
    saved = skeleton(root)
    size, digest, changed, made = msgpack.unpackb(saved.state())
    assert (size, digest, changed, made) == (saved.size, saved.digest, [], [])


@pytest.mark.parametrize(
    ("thing", "why"),
    [
        ((number for number in range(3)), "generator of dict of Root is a builtins.generator, which has no form"),
        (lambda: 1, "function of dict of Root was made meanwhile"),
        (ValueError("x"), "ValueError of dict of Root is a builtins.ValueError, which has no form"),
    ],
)
def test_what_has_no_form_on_disk_is_named_with_its_path(thing, why):
    root = Root()
    saved = skeleton(root)
    root.known["thing"] = thing
    with pytest.raises(UnsavedError, match=why):
        saved.state()


@pytest.mark.parametrize(
    ("made", "why"),
    [
        ([["object", "os", "system", []]], "it names os.system, which is not of rmr"),
        ([["function", "builtins", "eval", []]], "it names builtins.eval, which is not of rmr"),
        ([["object", "rmr.base.geometry", "math", []]], "names rmr.base.geometry.math, which is not defined there"),
        ([["function", "rmr.mind.graph_restoration", "sys.modules.get"]], "which is not defined there"),
        ([["function", "rmr.base.geometry", "math.sqrt"]], "which is not defined there"),
        ([["function", "rmr.base.geometry", "Point.__init_subclass__"]], "which is not there"),
        ([["object", "rmr.mind.graph_restoration", "Restoration.__module__.join", []]], "which is not defined there"),
        ([["method", ["class", "rmr.base.geometry", "Point"], "__subclasses__"]], "a method __subclasses__ of a type"),
        ([["method", ["class", "rmr.base.geometry", "Point"], "x"]], "a method x of a type, which has none"),
        ([["partial", [["class", "rmr.base.geometry", "Point"], [], {}]]], "unknown kind 'partial'"),
        ([["object", "rmr.nowhere", "Thing", []]], "which is not there"),
        ([["code", "x"]], "unknown kind 'code'"),
    ],
)
def test_octets_that_name_what_is_not_of_rmr_are_refused(made, why):
    root = Root()
    saved = skeleton(root)
    number = saved._walk.numbers[id(root.known)]
    data = msgpack.packb([saved.size, saved.digest, [[number, ["dict", ["x", [saved.size]]]]], made])
    with pytest.raises(GraphMismatchError, match=why):
        saved.restore(data)
    assert root.known == {}


def test_the_state_of_another_skeleton_is_refused():
    state = skeleton(Root()).state()
    other = Root()
    other.known["x"] = []
    with pytest.raises(GraphMismatchError, match="put together in another way"):
        skeleton(other).restore(state)
    with pytest.raises(GraphMismatchError, match="no msgpack of a state"):
        skeleton(Root()).restore(state[:-1])
