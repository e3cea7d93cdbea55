"""Cases as files: the octets of the program and the script as JSON, and both as a reader wants them.

A kept case needs nothing of the fuzzer to be played again; the disassembly and the difference that the case once
showed stand beside it for the reader alone.
"""

import json
from pathlib import Path

from fuzz_compare import Case
from fuzz_events import Step, from_json, to_json

from rmr.bytecode.codec import decode, encode
from rmr.bytecode.disassemble import disassemble

KEPT = Path(__file__).parent / "kept"


def kept() -> list[Path]:
    """Return the files of all kept cases, sorted."""
    return sorted(KEPT.glob("*.json"))


def write(path: Path, case: Case, why: str) -> None:
    """Write a case; `why` says what it showed."""
    octets = encode(case.program, debug=True)
    thing = {
        "why": why.splitlines(),
        "budget": case.budget,
        "draws": case.draws,
        "robot": case.robot,
        "small": case.small,
        "trace": case.trace,
        "script": [[step.call, *(to_json(arg) for arg in step.args)] for step in case.script],
        "program": octets.hex(),
        "disassembly": disassemble(octets).splitlines(),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(_laid_out(thing), "utf-8")


def read(path: Path) -> Case:
    """Return the case in a file."""
    thing = json.loads(path.read_text("utf-8"))
    script = tuple(Step(call, tuple(map(from_json, args))) for call, *args in thing["script"])
    program = decode(bytes.fromhex(thing["program"]))
    return Case(program, script, *[thing[each] for each in ("budget", "draws", "robot", "small", "trace")])


def _laid_out(thing: dict[str, object]) -> str:
    """Return JSON with the items of a list on lines of their own, and no deeper."""
    lines = []
    for key, value in thing.items():
        items = [json.dumps(item, ensure_ascii=False) for item in value] if isinstance(value, list) else None
        text = json.dumps(value) if items is None else "[\n    " + ",\n    ".join(items) + "\n  ]"
        lines.append(f"  {json.dumps(key)}: {text}")
    return "{\n" + ",\n".join(lines) + "\n}\n"
