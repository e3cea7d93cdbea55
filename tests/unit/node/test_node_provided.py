"""The table of provided actions and the handlers of nodes name each other completely."""

from inspect import signature

from rmr.bytecode.provided import ACTIONS
from rmr.node.actions.built_in import HANDLERS, PROVIDED


def test_each_provided_action_has_a_handler_and_each_handler_an_action():
    assert {action.handler for action in ACTIONS.values()} == set(HANDLERS)
    assert list(PROVIDED) == list(ACTIONS)


def test_handlers_take_the_arguments_of_their_actions():
    for name, handler in PROVIDED.items():
        _robot, *arguments = signature(handler.run).parameters
        assert len(arguments) == len(ACTIONS[name].types), name
