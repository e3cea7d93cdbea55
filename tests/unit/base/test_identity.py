"""What is worked out of an object is worked out once, for that very object."""

from rmr.base.identity import REMEMBERED_MAX, ByIdentity


def test_the_same_object_is_looked_at_once_and_an_equal_one_again():
    looked: list[list[int]] = []
    first = ByIdentity(lambda key: looked.append(key) or len(looked))
    one, equal = [1], [1]
    assert [first(one), first(equal), first(one)] == [1, 2, 1]


def test_the_oldest_objects_are_forgotten():
    looked: list[object] = []
    length = ByIdentity(lambda key: looked.append(key) or len(key))
    keys = [[0] * size for size in range(REMEMBERED_MAX + 1)]
    assert [length(key) for key in keys] == list(range(REMEMBERED_MAX + 1))
    length(keys[-1])
    assert len(looked) == REMEMBERED_MAX + 1
    length(keys[0])
    assert len(looked) == REMEMBERED_MAX + 2
