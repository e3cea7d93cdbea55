"""The histogram of a sweep: bins, bars, encodings."""

import io

import pytest

from rmr_sim.sweep_summary import BAR_WIDTH, BINS_MAX, binned, histogram_lines


def rows(*ratios, finished=True, bound=True):
    return [{"finished": finished, "time_to_bound": each if bound else None, "time_s": each} for each in ratios]


def terminal(encoding):
    return io.TextIOWrapper(io.BytesIO(), encoding=encoding)


def test_histogram_has_a_line_for_each_bin_with_bar_and_number():
    lines = histogram_lines(rows(1.50, 1.52, 1.52, 1.58), terminal("utf-8"))
    assert lines[0] == "time / bound of 4 finished runs"
    assert len(lines) == 10
    assert lines[1] == f"  1.50 to 1.51  {'█' * 20} 1"
    assert lines[2] == "  1.51 to 1.52  0"
    assert lines[3] == f"  1.52 to 1.53  {'█' * 40} 2"


@pytest.mark.parametrize(("encoding", "mark"), [("ascii", "#"), ("latin-1", "#"), ("utf-8", "█"), ("cp1252", "#")])
def test_histogram_is_ascii_where_the_encoding_has_no_blocks(encoding, mark):
    out = terminal(encoding)
    lines = histogram_lines(rows(1.0, 2.0), out)
    assert mark * BAR_WIDTH in lines[1]
    "\n".join(lines).encode(encoding)


def test_histogram_shows_times_where_no_bound_is_known_and_nothing_of_a_single_run():
    assert histogram_lines(rows(10.0, 12.0, bound=False), io.StringIO())[0] == "time, s of 2 finished runs"
    assert histogram_lines(rows(10.0), io.StringIO()) == []
    assert histogram_lines(rows(10.0, 11.0, finished=False), io.StringIO()) == []


@pytest.mark.parametrize(
    "values", [[1.0, 1.0], [0.0, 0.0], [1.5, 1.5001], [1.0, 1e6], [0.3, 0.6, 0.9], [59.99, 60.0], [1e-9, 2e-9]]
)
def test_every_value_is_in_one_of_at_most_twelve_bins(values):
    counts, step = binned(values)
    assert sum(counts.values()) == len(values)
    assert len(counts) <= BINS_MAX
    assert list(counts) == list(range(min(counts), max(counts) + 1))
    assert (
        min(counts) * step <= min(values) + 1e-6 <= max(values) + 2e-6 <= (max(counts) + 1) * step + 1e-3 * step + 1e-6
    )
    assert all(len(line) <= 80 for line in histogram_lines(rows(*values), io.StringIO()))


def test_a_rare_value_is_visible_beside_a_frequent_one():
    lines = histogram_lines(rows(*[1.0] * 1000, 2.0), io.StringIO())
    assert lines[1].endswith(" 1000")
    assert lines[-1].endswith("▏ 1")
