"""Who is in radio range of whom."""

import json

import pytest

from rmr.eval.options import OptionError
from rmr.eval.topology import NAMES, Complete, from_text, named, read


def ids(number):
    return dict.fromkeys(range(1, number + 1))


def pairs(topology, robots):
    """Every pair once, as the topology lists neighbours."""
    return [(one, other) for one in robots for other in topology.neighbors(one) if one < other]


@pytest.mark.parametrize(
    ("name", "number", "expected"),
    [
        ("complete", 3, [(1, 2), (1, 3), (2, 3)]),
        ("line", 4, [(1, 2), (2, 3), (3, 4)]),
        ("ring", 4, [(1, 2), (1, 4), (2, 3), (3, 4)]),
        ("ring", 3, [(1, 2), (1, 3), (2, 3)]),
        ("ring", 2, [(1, 2)]),
        ("star", 4, [(1, 2), (1, 3), (1, 4)]),
        ("grid", 4, [(1, 2), (1, 3), (2, 4), (3, 4)]),
        ("grid", 5, [(1, 2), (1, 4), (2, 3), (2, 5), (4, 5)]),
        ("grid", 2, [(1, 2)]),
    ],
)
def test_each_shape_pairs_the_robots_that_it_says(name, number, expected):
    robots = ids(number)
    assert pairs(named(name, robots), robots) == expected


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("number", [1, 2, 3, 7, 16])
def test_range_is_mutual_and_never_to_oneself(name, number):
    robots = dict.fromkeys(range(0, 3 * number, 3))
    topology = named(name, robots)
    for one in robots:
        near = list(topology.neighbors(one))
        assert near == sorted(near)
        assert topology.degree(one) == len(near)
        assert one not in near
        for other in robots:
            assert topology.adjacent(one, other) == topology.adjacent(other, one) == (other in near)


def test_shapes_follow_the_ids_in_ascending_order_whatever_they_are():
    robots = dict.fromkeys([2, 5, 40])
    assert pairs(named("line", robots), robots) == [(2, 5), (5, 40)]
    assert pairs(named("star", robots), robots) == [(2, 5), (2, 40)]


def test_the_complete_topology_is_never_spelt_out():
    everybody = Complete(ids(65_533))
    assert everybody.degree(1) == 65_532
    assert everybody.adjacent(1, 65_533)
    assert not everybody.adjacent(1, 65_534)


TEXTS = [
    "1 2\n2 3\n",
    "# a file\n1-2   # the first\n\n2, 3\n",
    "1 - 2\n3 2\n2 3",
    json.dumps([[1, 2], [3, 2]]),
    "\n [[1, 2],\n [2, 3]]",
]


@pytest.mark.parametrize("text", TEXTS)
def test_a_file_lists_pairs_as_lines_or_as_json(text, tmp_path):
    (tmp_path / "net").write_text(text)
    topology = read(str(tmp_path / "net"), ids(4))
    assert pairs(topology, ids(4)) == [(1, 2), (2, 3)]
    assert topology.degree(4) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2\n1 two\n", r"net:2: expected two robots such as 1 2 or 1-2, found '1 two'"),
        ("1 2 3\n", r"net:1: expected two robots"),
        ("# x\n\n1 9\n", r"net:3: robot 9 is not among the robots of --robots"),
        ("2 2\n", r"net:1: robot 2 is paired with itself"),
        ("1 " + "9" * 5000, r"net:1: expected two robots"),
        ('{"1": 2}', r"net:1: expected two robots"),
        ("[[1, 2], [1, true]]", r"net: item 2: expected a pair such as \[1, 2\], found '\[1, true\]'"),
        ("[[1, 2, 3]]", r"net: item 1: expected a pair"),
        ("[[1, 7]]", r"net: item 1: robot 7 is not among"),
        ("[[1, 2],\n", r"net:2:1: this is no JSON"),
        ("[" * 100_000, r"net:1: this is no list of pairs"),
        ("[[1, " + "9" * 5000 + "]]", r"net:1: this is no list of pairs"),
    ],
)
def test_mistake_in_a_topology_file_is_reported_with_its_place(text, message):
    with pytest.raises(OptionError, match=message):
        from_text(text, "net", ids(4))


def test_unknown_topology_name_is_reported_with_the_valid_names(tmp_path):
    with pytest.raises(OptionError, match="there is no file 'rnig'; did you mean `ring`"):
        read("rnig", ids(2))
    with pytest.raises(OptionError, match="write complete, line, ring, grid, star, or a file"):
        read(str(tmp_path / "none"), ids(2))
    with pytest.raises(OptionError, match=r"cannot read .*directory"):
        read(str(tmp_path), ids(2))


def test_a_file_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "net").write_bytes(b"1 2\n\xff\xfe")
    with pytest.raises(OptionError, match="not UTF-8 at octet 4"):
        read(str(tmp_path / "net"), ids(2))
