"""The bill of materials: what is in it, that it is valid CycloneDX, and that equal sources give equal octets."""

import hashlib
import json
import runpy
import tomllib
from importlib.metadata import requires
from pathlib import Path

import jsonschema
import pytest
from referencing import Registry, Resource

ROOT = Path(__file__).parents[3]
SCHEMAS = Path(__file__).with_name("cyclonedx")
SBOM = runpy.run_path(str(ROOT / "deploy" / "release" / "sbom.py"))
LOCK = (ROOT / "requirements.lock").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
HASH = "    --hash=sha256:" + "0" * 64


def made(epoch=None, lock=LOCK):
    return SBOM["document"](PROJECT, SBOM["read_lock"](lock), epoch)


def names(scope):
    return {each["name"] for each in made()["components"] if each["scope"] == scope}


def validator():
    schemas = [json.loads(file.read_text()) for file in SCHEMAS.glob("*.json")]
    registry = Registry().with_resources([(each["$id"], Resource.from_contents(each)) for each in schemas])
    [bom] = [each for each in schemas if "bom-1.6" in each["$id"]]
    return jsonschema.Draft7Validator(bom, registry=registry)


def test_the_schemas_are_as_published():
    for line in (SCHEMAS / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split()
        assert hashlib.sha256((SCHEMAS / name).read_bytes()).hexdigest() == digest, name


def test_the_document_is_valid():
    assert list(validator().iter_errors(made("1700000000"))) == []
    wrong = made()
    wrong["components"][0]["scope"] = "perhaps"
    assert len(list(validator().iter_errors(wrong))) == 1, "the schema is applied"


def test_every_package_of_the_lock_is_in_it_with_its_hashes():
    components = made()["components"]
    assert len(components) == LOCK.count("==") - LOCK.count(" == '")
    digests = [each["content"] for one in components for each in one["externalReferences"][0]["hashes"]]
    assert len(digests) == LOCK.count("--hash=sha256:")


def test_scopes_are_those_of_an_installation():
    direct = SBOM["names_of"](PROJECT["dependencies"])
    assert direct < names("required")
    assert {"anyio", "cffi"} <= names("required"), "what these ask for"
    assert {"pygls", "matplotlib", "distributed"} <= names("optional")
    assert {"pytest", "mypy", "hatchling"} <= names("excluded")
    installed = SBOM["names_of"](each for each in requires("starlette") if "extra ==" not in each and ";" not in each)
    assert installed <= names("required")


def test_each_dependency_leads_to_components():
    document = made()
    known = {each["bom-ref"] for each in document["components"]}
    root, *others = document["dependencies"]
    assert root["ref"] == document["metadata"]["component"]["bom-ref"]
    assert {each["ref"] for each in others} == known
    assert {ref for each in document["dependencies"] for ref in each["dependsOn"]} <= known


def test_equal_sources_give_equal_octets():
    assert json.dumps(made("1700000000")) == json.dumps(made("1700000000"))
    assert made("1700000000")["metadata"]["timestamp"] == "2023-11-14T22:13:20Z"
    assert made("1700000000")["serialNumber"] != made("1700000001")["serialNumber"]


@pytest.mark.parametrize(
    ("lock", "told"),
    [
        ("", "no package is in it"),
        ("numpy==1.0\n", "numpy has no hash"),
        (f"numpy==1.0 \\\n{HASH}\n!\n", "line 3 is none of uv's: '!'"),
        (f"numpy==1.0 \\\n{HASH}\n    # via x\n", "in pyproject.toml, not in the lock"),
    ],
)
def test_a_lock_that_cannot_be_used_is_refused_with_what_to_do(lock, told):
    with pytest.raises(SBOM["LockError"], match=told) as refusal:
        made(lock=lock)
    assert "make lock" in str(refusal.value)


def test_a_wrong_time_is_refused(monkeypatch, capsys):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    assert SBOM["main"]([]) == 2
    assert capsys.readouterr().err.startswith("sbom: SOURCE_DATE_EPOCH is 'yesterday': write seconds since 1970")
