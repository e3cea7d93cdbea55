"""docs/python.md says what the code says: names, arguments with their defaults, exceptions."""

import inspect

from doc_pages import codes, page, table

import rmr

PAGE = page("python")


def arguments(function):
    """The names of a function's arguments."""
    return set(inspect.signature(function).parameters)


def test_every_name_of_the_api_is_on_the_page():
    assert [name for name in rmr.__all__ if f"`rmr.{name}" not in PAGE] == []


def test_the_arguments_of_evaluate_and_simulate_are_documented_and_no_others():
    rows = table(PAGE, "argument", "option of `rmr eval`", "default")
    assert {name for row in rows for name in codes(row[0])} == arguments(rmr.evaluate)
    rows = table(PAGE, "argument", "option of `rmr sim`", "default")
    assert {name for row in rows for name in codes(row[0])} == arguments(rmr.simulate)


def test_the_arguments_of_sweep_are_documented_and_are_those_of_simulate():
    rows = table(PAGE, "argument", "means", "default")
    assert {name for row in rows for name in codes(row[0])} == arguments(rmr.sweep)
    assert arguments(rmr.sweep) - {"map", "seeds"} == arguments(rmr.simulate) - {"seed", "rate"}


def test_the_exceptions_are_documented_and_no_others():
    errors = {f"rmr.{name}" for name in rmr.__all__ if name.endswith("Error")} - {"rmr.Error"}
    assert {codes(row[0])[0] for row in table(PAGE, "exception", "raised when")} == errors
