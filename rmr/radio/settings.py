"""The settings of a lab's radio that people choose, a row each.

The model itself is `rmr.radio.phy.RadioConfig`: a row bears the name of one of its fields, whose default it has. From
these rows come the keys of a lab file (`radio:`), the options of `rmr radio`, and the bounds within which a robot
accepts what the world tells it. A new setting is a field of the model, its effect there, and a row here.
"""

from typing import Any, NamedTuple

from rmr.radio.phy import NETWORK, RadioConfig

_DEFAULTS = RadioConfig()


class Setting(NamedTuple):
    """One setting of the radio."""

    name: str
    """The field of `RadioConfig`, and the key in a lab file."""
    limits: tuple[float, float] | None = None
    """Least and greatest value in a lab file; None of what is no number."""
    choices: tuple[str, ...] = ()
    """The words that it may be; empty of what is no word."""
    option: str = ""
    """The option of `rmr radio`; empty where it has none."""
    trial_limits: tuple[float, float] = (0.0, 0.0)
    """Least and greatest value of the option: beyond them an experiment has no place for its stations."""
    metavar: str = ""
    """What stands for the option's value in the help, a unit where it has one."""
    help: str = ""

    @property
    def default(self) -> Any:
        """The default of the model."""
        return getattr(_DEFAULTS, self.name)


SETTINGS = (
    Setting("mode", choices=("802.15.4", NETWORK)),
    Setting(
        "tx_power_dbm",
        limits=(-60, 30),
        option="--tx-power",
        trial_limits=(-60, 40),
        metavar="DBM",
        help="Power that is sent, dBm.",
    ),
    Setting(
        "sensitivity_dbm",
        limits=(-150, 0),
        option="--sensitivity",
        trial_limits=(-130, -40),
        metavar="DBM",
        help="Weakest power that is received, dBm; real radios -85 to -101.",
    ),
    Setting(
        "exponent",
        limits=(1, 8),
        option="--exponent",
        trial_limits=(1.5, 6),
        metavar="N",
        help="How fast power falls with distance: 2 in the open, 3 in a room.",
    ),
    Setting(
        "shadowing_db",
        limits=(0, 30),
        option="--shadowing",
        trial_limits=(0, 30),
        metavar="DB",
        help="By how much links of one length differ: standard deviation, dB.",
    ),
    Setting(
        "loss",
        limits=(0, 1),
        option="--loss",
        trial_limits=(0, 1),
        metavar="SHARE",
        help="Share of frames that are lost besides.",
    ),
    Setting("bursts"),
    Setting(
        "interference",
        choices=("capture_3db", "awgn"),
        option="--interference",
        help="capture_3db: a frame must be 3 dB above all others, as with real radios. awgn: others are like noise, "
        "as in ns-3; more frames survive.",
    ),
)
"""All settings, in the order in which help and schema list them."""
