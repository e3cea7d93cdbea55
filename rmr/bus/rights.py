"""What each role may do on the bus: one table, of which the rules of the routers, the page and the tests are made.

A router, or a world that listens, knows whoever is connected by the common name of its certificate, and carries what
the table allows it alone. zenoh's rules cannot change while it runs, and know no wild cards in names: the subjects are
those that the listener was given with its keys (`rmr.bus.certificates.MEMBERS_FILE`).
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

RIGHTS: Final[Mapping[str, Mapping[str, tuple[str, ...]]]] = {
    "robot": {
        "puts": (
            "radio/*/*/{n}",
            "call/*/{n}",
            "body/{n}/act",
            "ops/{n}/status",
            "load/operator/{n}",
            "echo/robot/{n}/*",
        ),
        "hears": (
            *("radio/*/*/*", "call/{n}/*", "body/{n}/sense", "clock", "disturbances"),
            *("ops/{n}/stop", "load/{n}", "echo/robot/{n}/*"),
        ),
        "asks": ("map/{n}", "clock"),
        "lives": ("alive/robot/{n}",),
        "watches": ("alive/world/0",),
    },
    "world": {
        "puts": ("body/*/sense", "clock", "disturbances", "truth", "ops/world/status", "echo/world/0/*"),
        "hears": ("body/*/act", "silence", "ops/*/status", "ops/world/stop", "echo/world/0/*"),
        "asks": ("clock", "disturbances"),  # whether another world is there
        "serves": ("clock", "map/*", "disturbances"),
        "lives": ("alive/world/0",),
        "watches": ("alive/robot/*",),
    },
    # It speaks for the processes of its host, whose rights it holds itself.
    "router": dict.fromkeys(("puts", "hears", "asks", "serves", "lives", "watches"), ("**",)),
    "operator": {
        "puts": ("silence", "ops/*/stop", "hosts/*", "load/*", "echo/operator/0/*"),
        "hears": ("truth", "ops/*/status", "hosts/*", "load/operator/*", "echo/operator/0/*"),
        "asks": ("disturbances", "hosts/*/order", "hosts/*/look"),
        "serves": ("hosts/*/order", "hosts/*/look"),  # a launcher
        "watches": ("alive/robot/*", "alive/world/0"),
    },
    "viewer": {
        "puts": ("echo/viewer/0/*",),
        "hears": ("truth", "ops/*/status", "hosts/*", "echo/viewer/0/*"),
        "asks": ("hosts/*/look",),
        "watches": ("alive/robot/*", "alive/world/0"),
    },
}
"""Role -> verb -> keys behind ``rmr/LAB/`` (`rmr.bus.keys`); ``{n}``: the id of each robot that the holder is."""

VERBS: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "puts": (("ingress", "put"), ("egress", "declare_subscriber")),
    "hears": (("ingress", "declare_subscriber"), ("egress", "put")),
    "asks": (("ingress", "query"), ("egress", "reply"), ("egress", "declare_queryable")),
    "serves": (("ingress", "declare_queryable"), ("ingress", "reply"), ("egress", "query")),
    "lives": (("ingress", "liveliness_token"),),
    "watches": (
        ("ingress", "declare_liveliness_subscriber"),
        ("ingress", "liveliness_query"),
        ("egress", "liveliness_token"),
    ),
}
"""Verb -> what zenoh calls it where the router receives (ingress) and where it sends (egress)."""

TOLD: Final = ("declare_subscriber", "declare_queryable")
"""What a router tells (egress) of others' declarations. zenoh's rule must include the whole key, and the world listens
to all wheel commands: what robot 4 may put on ``body/4/act`` it is told to be wanted on ``body/*/act``."""


def access_control(members: Mapping[str, tuple[str, Sequence[int]]], *, joins: bool) -> dict[str, Any]:
    """Return the settings of zenoh, by key, for a router that lets members do what the table says, and nobody else.

    `members`: the subject of each certificate, its role, the robots that it may be. `joins`: the router connects
    to other listeners. One of these may be the world, which then routes as well.
    """
    rules: dict[str, dict[str, Any]] = {}
    held: dict[str, list[str]] = {}
    for subject, (role, robots) in members.items():
        acts_as = "router" if role == "world" and joins else role
        own = [rule for robot in robots or (0,) for rule in _rules(acts_as, robot)]
        rules |= {rule["id"]: rule for rule in own}
        held[subject] = [rule["id"] for rule in own]
    return {
        "access_control/enabled": True,
        "access_control/default_permission": "deny",
        "access_control/rules": list(rules.values()),
        "access_control/subjects": [{"id": subject, "cert_common_names": [subject]} for subject in held],
        "access_control/policies": [{"rules": ids, "subjects": [subject]} for subject, ids in held.items()],
    }


def _rules(role: str, robot: int) -> Iterator[dict[str, Any]]:
    """Yield one rule for each verb of a role, and each form that zenoh has for it."""
    for verb, keys in RIGHTS[role].items():
        for flow, message in VERBS[verb]:
            own = "*" if flow == "egress" and message in TOLD else str(robot)
            yield {
                "id": f"{role}/{robot} {verb}: {flow} {message}",
                "permission": "allow",
                "flows": [flow],
                "messages": [message],
                "key_exprs": ["rmr/**" if key == "**" else f"rmr/*/{key.replace('{n}', own)}" for key in keys],
            }
