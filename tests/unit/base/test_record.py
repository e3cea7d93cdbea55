"""Records behave as frozen dataclasses do, but for what the type checker holds alone."""

import pickle
from dataclasses import asdict, fields, is_dataclass, replace

import pytest

from rmr.base.record import record


@record
class Place:
    """Where something is."""

    file: str
    line: int = 1

    @property
    def next(self) -> int:
        """The line below."""
        return self.line + 1


@record
class Nowhere:
    """No place at all."""


def test_slots_are_filled_in_order_by_name_or_by_default():
    assert (Place("a", 2).file, Place("a").line, Place(line=3, file="b").line) == ("a", 1, 3)
    assert Place("a").next == 2
    with pytest.raises(TypeError):
        Place()


def test_two_are_equal_if_their_class_and_all_slots_are():
    assert Place("a") == Place("a", 1)
    assert Place("a") != Place("a", 2)
    assert Place("a") != ("a", 1)
    assert Nowhere() == Nowhere()
    assert len({Place("a"), Place("a", 1), Place("b"), Nowhere(), Nowhere()}) == 3


def test_a_record_shows_its_slots_and_is_matched_by_them():
    assert repr(Place("a")) == "Place(file='a', line=1)"
    match Place("a", 4):
        case Place(_, line):
            assert line == 4


def test_a_record_has_no_room_for_anything_else():
    with pytest.raises(AttributeError):
        Place("a").column = 3


def test_what_takes_dataclasses_takes_records():
    assert is_dataclass(Place)
    assert [field.name for field in fields(Place)] == ["file", "line"]
    assert asdict(Place("a")) == {"file": "a", "line": 1}


def test_a_copy_differs_where_it_is_told_to():
    assert replace(Place("a", 2), line=3) == Place("a", 3)
    assert pickle.loads(pickle.dumps(Place("a", 2))) == Place("a", 2)


def test_a_record_keeps_its_documentation():
    assert Place.__doc__ == "Where something is."
    assert Place.__module__ == __name__
