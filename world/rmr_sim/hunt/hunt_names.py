"""The words of a hunt's options. They stand alone, so that help and wrong usage load nothing else."""

from typing import Final

CONTACT: Final = "contact"
EXCLUSION: Final = "exclusion"
UNFINISHED: Final = "unfinished"
RULES: Final = "rules"

PROPERTIES: Final = (CONTACT, EXCLUSION, UNFINISHED, RULES)
"""What a hunt can look for: contacts of hulls; robots inside in directions that exclude each other (the check
`overlap`); robots that have not finished when the lab's duration is over after the last fault; any other check."""
DEFAULT_PROPERTIES: Final = (CONTACT, EXCLUSION, UNFINISHED)

METHODS: Final = (
    "link", "links", "partition", "mute", "deaf", "loss", "stall", "slow", "crash", "crashes", "loop", "outage", "lost",
)  # fmt: skip
"""The ways to attack a support (`candidates`)."""
