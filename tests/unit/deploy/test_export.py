"""`rmr export`: the same octets from the same input, what they start, and what engines say of them."""

import configparser
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest
import yaml
from command_runner import invoke
from PIL import Image

import rmr_deploy.export
from rmr.bus.authority import Authority, holder, write_bundle
from rmr.bus.certificates import read_certificate
from rmr_deploy.export import ENGINES, command, exec_start

GOLDEN = Path(__file__).parent / "exported"
HOSTS = """\
hosts:
  a: {address: 10.0.0.5, world: true}
  b: {robots: 1-3}
  c: {robots: 4-6, router: false}
"""


def export(tmp_path, engine, *options, hosts=HOSTS, lab="corridor", out="out"):
    file = tmp_path / "hosts.yaml"
    file.write_text(hosts)
    words = [engine, lab, "--hosts", str(file), "-o", str(tmp_path / out), *options]
    return invoke(command(), words)


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("engine", ENGINES)
def test_the_same_input_gives_the_kept_octets(tmp_path, engine):
    assert export(tmp_path, engine).exit_code == 0
    assert export(tmp_path, engine, out="again").exit_code == 0
    found = files(tmp_path / "out")
    assert found == files(tmp_path / "again")
    of_hosts = {name: text for name, text in found.items() if not name.startswith("lab/")}
    if os.environ.get("RMR_REWRITE"):
        for name, text in of_hosts.items():
            path = GOLDEN / engine / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(text)
    assert of_hosts == files(GOLDEN / engine)
    assert sorted(name for name in found if name.startswith("lab/")) == ["lab/lab.yaml", "lab/program.rbc"]


def exported_with_map(tmp_path, engine, name, more=""):
    """Export a lab of one robot whose floor is an image; return the folder."""
    lab = tmp_path / "own"
    (lab / "floor").mkdir(parents=True)
    for program in ("work.rmr", "next.rmr"):
        (lab / program).write_text("done(R).\n")
    (lab / "floor" / "map.yaml").write_text("{image: floor.png, resolution: 0.05}")
    Image.new("L", (20, 20), 255).save(lab / "floor" / "floor.png")
    (lab / "lab.yaml").write_text(
        f"{{lab: {name}, program: work.rmr, duration: 2s, arena: {{size: [1, 1]}}, map: floor/map.yaml,"
        f" robots: [{{id: 1, pose: [0.5, 0.5, 0deg]}}]{more}}}"
    )
    hosts = "hosts:\n  a: {world: true, robots: 1}\n"
    assert export(tmp_path, engine, "--open", hosts=hosts, lab=str(lab)).exit_code == 0
    return tmp_path / "out"


def test_the_lab_has_its_map_with_the_image_and_the_programs_of_its_loads(tmp_path):
    out = exported_with_map(tmp_path, "systemd", "own", ", loads: [{at: 1s, program: next.rmr}]")
    assert sorted(name for name in files(out) if name.startswith("lab/")) == [
        "lab/floor/floor.png",
        "lab/floor/map.yaml",
        "lab/lab.yaml",
        "lab/next.rmr",
        "lab/program.rbc",
    ]


def test_units_start_the_commands_of_a_host(tmp_path):
    export(tmp_path, "systemd")
    started = {}
    for path in (tmp_path / "out").glob("*/*.service"):
        unit = configparser.ConfigParser(strict=False, interpolation=None)
        unit.optionxform = str
        unit.read_string(path.read_text())
        assert unit["Service"]["User"] == "rmr"
        assert unit["Service"]["ProtectSystem"] == "strict"
        started[f"{path.parent.name}/{path.stem.removeprefix('rmr-corridor-')}"] = unit["Service"]["ExecStart"]
    robots = [f"b/robot-{robot}" for robot in (1, 2, 3)] + [f"c/robot-{robot}" for robot in (4, 5, 6)]
    assert sorted(started) == ["a/router", "a/world", *robots[:3], "b/router", *robots[3:]]
    secret = "--secret /etc/rmr-corridor/secret"
    assert started["a/router"] == f"/opt/rmr/bin/rmr router --listen tcp/0.0.0.0:17447 {secret}"
    assert started["b/router"].endswith(f"--listen tcp/127.0.0.1:17447 --connect tcp/10.0.0.5:17447 {secret}")
    assert "--connect tcp/127.0.0.1:17447" in started["b/robot-1"]
    assert "--connect tcp/10.0.0.5:17447" in started["c/robot-4"]


def test_services_are_not_root_and_read_only(tmp_path):
    export(tmp_path, "compose")
    for path in (tmp_path / "out").glob("*/compose.yaml"):
        for name, service in yaml.safe_load(path.read_text())["services"].items():
            assert (service["user"], service["read_only"], service["cap_drop"]) == ("10001:10001", True, ["ALL"])
            assert service["healthcheck"]["test"][0] == "CMD"
            assert ("ports" in service) == (path.parent.name == "a" and name == "router")


# --- Kubernetes


SCHEMAS = Path(__file__).with_name("kubernetes")
KINDS = {
    "Deployment": "io.k8s.api.apps.v1.Deployment",
    "Service": "io.k8s.api.core.v1.Service",
    "PersistentVolumeClaim": "io.k8s.api.core.v1.PersistentVolumeClaim",
}


def objects(folder):
    """Return the objects of all hosts by kind and name, each of which its schema takes."""
    found = {}
    schemas = json.loads((SCHEMAS / "v1.31.json").read_text())
    for path in sorted(folder.glob("*/kubernetes.yaml")):
        for each in yaml.safe_load_all(path.read_text()):
            jsonschema.validate(each, {**schemas, "$ref": f"#/definitions/{KINDS[each['kind']]}"})
            found[each["kind"], each["metadata"]["name"]] = each
    return found


def test_the_schemas_of_kubernetes_are_those_that_were_taken():
    for line in (SCHEMAS / "SHA256SUMS").read_text().splitlines():
        told, name = line.split()
        assert hashlib.sha256((SCHEMAS / name).read_bytes()).hexdigest() == told


def test_kubernetes_takes_the_objects_of_each_host(tmp_path):
    assert export(tmp_path, "k8s").exit_code == 0
    found = objects(tmp_path / "out")
    assert sorted(found) == [
        *(("Deployment", f"rmr-corridor-{host}") for host in "abc"),
        *(("PersistentVolumeClaim", f"rmr-corridor-{host}") for host in "abc"),
        ("Service", "rmr-corridor-a"),
    ]
    broken = found["Deployment", "rmr-corridor-a"]
    broken["spec"]["template"]["spec"]["containers"][0]["readOnly"] = True
    path = tmp_path / "out" / "a" / "kubernetes.yaml"
    path.write_text(yaml.safe_dump(broken))
    with pytest.raises(jsonschema.ValidationError, match="'readOnly' was unexpected"):
        objects(tmp_path / "out")


def test_a_pod_starts_the_commands_of_its_host_not_as_root_and_read_only(tmp_path):
    export(tmp_path, "k8s")
    started = {}
    for (kind, name), each in objects(tmp_path / "out").items():
        if kind != "Deployment":
            continue
        pod = each["spec"]["template"]["spec"]
        assert (pod["securityContext"]["runAsNonRoot"], pod["automountServiceAccountToken"]) == (True, False)
        labels = each["spec"]["template"]["metadata"]["labels"]
        assert each["spec"]["selector"]["matchLabels"] == labels
        volumes = {volume["name"] for volume in pod["volumes"]}
        for container in [*pod["initContainers"], *pod["containers"]]:
            assert container["securityContext"]["readOnlyRootFilesystem"]
            assert container["securityContext"]["capabilities"] == {"drop": ["ALL"]}
            assert {mount["name"] for mount in container["volumeMounts"]} <= volumes
        started |= {f"{name}/{one['name']}": " ".join(one["command"]) for one in pod["containers"]}
        assert [one["name"] for one in pod["containers"] if "livenessProbe" in one] == (
            ["router"] if name != "rmr-corridor-c" else []
        )
    secret = "--secret /secret"
    assert started["rmr-corridor-a/router"] == f"rmr router --listen tcp/0.0.0.0:17447 {secret}"
    joins = f"rmr router --listen tcp/127.0.0.1:17447 --connect tcp/rmr-corridor-a:17447 {secret}"
    assert started["rmr-corridor-b/router"] == joins
    assert "--connect tcp/127.0.0.1:17447" in started["rmr-corridor-b/robot-1"]
    assert "--connect tcp/rmr-corridor-a:17447" in started["rmr-corridor-c/robot-4"]
    service = objects(tmp_path / "out")["Service", "rmr-corridor-a"]["spec"]
    assert service["selector"] == {
        "app.kubernetes.io/part-of": "rmr-corridor",
        "app.kubernetes.io/component": "a",
    }
    assert service["ports"] == [{"port": 17447}]


def kustomization(folder):
    """Return the file that kubectl reads first; all that it names is there, but for what a person puts there."""
    made = yaml.safe_load((folder / "kustomization.yaml").read_text())
    assert (made["apiVersion"], made["kind"]) == ("kustomize.config.k8s.io/v1beta1", "Kustomization")
    known = {"apiVersion", "kind", "resources", "images", "configMapGenerator", "secretGenerator"}
    assert made.keys() <= known, "fields of kustomize that were looked up in its reference"
    assert all((folder / name).is_file() for name in made["resources"])
    return made


def test_the_files_of_the_lab_reach_a_pod_by_their_paths(tmp_path):
    out = exported_with_map(tmp_path, "k8s", "my_own")
    made = kustomization(out)
    assert "secretGenerator" not in made
    (given,) = made["configMapGenerator"]
    sources = dict(each.split("=") for each in given["files"])
    (pod,) = [each["spec"]["template"]["spec"] for (kind, _), each in objects(out).items() if kind == "Deployment"]
    (volume,) = [each["configMap"] for each in pod["volumes"] if each["name"] == "lab"]
    assert volume["name"] == given["name"] == "rmr-my-own-lab"
    placed = {item["path"]: sources[item["key"]] for item in volume["items"]}
    assert placed == {name: f"lab/{name}" for name in ("program.rbc", "lab.yaml", "floor/map.yaml", "floor/floor.png")}
    assert all((out / source).is_file() for source in placed.values())


@pytest.mark.medium
@pytest.mark.real
def test_what_lets_processes_in_becomes_their_own(tmp_path):
    """A volume of Kubernetes has symbolic links, and files that a group can read."""
    lab = tmp_path / "lab"
    shutil.copytree(Path(__file__).parents[3] / "deploy" / "labs" / "corridor", lab)
    with (lab / "lab.yaml").open("a") as file:
        file.write("bus: {security: mtls}\n")
    assert export(tmp_path, "k8s", lab=str(lab)).exit_code == 0
    secrets = {each["name"]: each["files"] for each in kustomization(tmp_path / "out")["secretGenerator"]}
    ca = Authority.begin(tmp_path / "ca")
    processes = {"router": holder("router", "a"), "world": holder("world"), "robot-1": holder("robot", "1")}
    given = tmp_path / "given" / "..data" / "keys"
    given.mkdir(parents=True)
    (tmp_path / "given" / "keys").symlink_to("..data/keys")
    for name, who in processes.items():
        ca.issue(who, () if name == "robot-1" else ("rmr-corridor-a",))
        write_bundle(ca.bundle(who), given / name)
        wanted = {f"keys/{name}/{path.name}" for path in (given / name).iterdir()}
        assert set(secrets[f"rmr-corridor-keys-{name}"]) == wanted
        for path in (given / name).iterdir():
            path.chmod(0o440)
    pod = objects(tmp_path / "out")["Deployment", "rmr-corridor-a"]["spec"]["template"]["spec"]
    sources = next(volume["projected"]["sources"] for volume in pod["volumes"] if volume["name"] == "given")
    paths = {item["path"] for source in sources for item in source["secret"]["items"]}
    assert {f"keys/{name}/key.pem" for name in ("router", "world")} <= paths
    (copier,) = pod["initContainers"]
    script = copier["command"][2].replace("/given", str(tmp_path / "given"))
    subprocess.run([sys.executable, "-c", script.replace("/admission", str(tmp_path / "own"))], check=True)
    for name, who in processes.items():
        assert read_certificate(tmp_path / "own" / "keys" / name).holder == who
    assert sorted(path.name for path in (tmp_path / "own").iterdir()) == ["keys"]


def test_what_kubernetes_cannot_have_is_told(tmp_path, monkeypatch):
    done = export(tmp_path, "k8s", hosts=HOSTS.replace("  b:", f"  {'b' * 60}:"))
    told = f"rmr-corridor-{'b' * 60} is too long for a name in Kubernetes, of 63 characters: shorten the lab's or the"
    assert (done.exit_code, told in done.stderr) == (2, True)
    monkeypatch.setattr(rmr_deploy.export, "CONFIG_MAP_OCTETS_MAX", 1000)
    done = export(tmp_path, "k8s")
    assert (done.exit_code, "and a ConfigMap of Kubernetes 1000 at most: export it for" in done.stderr) == (2, True)
    assert not (tmp_path / "out").exists()


def test_without_a_secret_a_listener_is_open_on_purpose(tmp_path):
    export(tmp_path, "systemd", "--open")
    text = (tmp_path / "out" / "a" / "rmr-corridor-router.service").read_text()
    assert "--listen tcp/0.0.0.0:17447 --open\n" in text
    assert "--open" not in (tmp_path / "out" / "b" / "rmr-corridor-router.service").read_text()


def test_what_cannot_be_exported_is_told(tmp_path):
    done = export(tmp_path, "systemd", hosts="hosts:\n  a: {world: true}\n")
    assert (done.exit_code, "robots 1-6 are on no host" in done.stderr) == (3, True)
    done = invoke(command(), ["compose", "corridor", "-o", str(tmp_path / "none")])
    assert (done.exit_code, "has no hosts: name a file that has with --hosts FILE" in done.stderr) == (2, True)
    done = export(tmp_path, "compose", out=".")
    assert (done.exit_code, "is there already and not empty" in done.stderr) == (2, True)
    done = export(tmp_path, "compose", hosts=HOSTS.replace("b:", "lab:"))
    assert (done.exit_code, "a host cannot have the name lab" in done.stderr) == (2, True)
    done = export(tmp_path, "systemd", hosts=HOSTS.replace("10.0.0.5", "127.0.0.1"))
    assert (done.exit_code, "no other host reaches a at 127.0.0.1" in done.stderr) == (2, True)


def test_a_router_in_a_container_is_reached_by_its_machine(tmp_path):
    """What listens at a container's own loopback is reached by nobody."""
    alone = "hosts:\n  a: {address: 127.0.0.1, world: true, robots: 1-6}\n"
    assert export(tmp_path, "compose", "--open", hosts=alone).exit_code == 0
    router = yaml.safe_load((tmp_path / "out" / "a" / "compose.yaml").read_text())["services"]["router"]
    assert router["command"] == ["rmr", "router", "--listen", "tcp/0.0.0.0:17447", "--open"]
    assert router["ports"] == ["127.0.0.1:17447:17447"]


def test_what_rmr_up_carries_out_itself_is_said_to_be_left_out(tmp_path):
    lab = tmp_path / "faulty"
    shutil.copytree(Path(__file__).parents[3] / "deploy" / "labs" / "corridor", lab)
    with (lab / "lab.yaml").open("a") as file:
        file.write("faults: [{kill: 2, at: 5s}]\n")
    assert "are left out: rmr load and rmr fault carry them out" in export(tmp_path, "systemd", lab=str(lab)).stdout
    assert "left out" not in export(tmp_path, "systemd", out="sound").stdout


def test_words_of_commands_are_quoted_as_units_read_them():
    assert exec_start(["a", "b c", "$X", "50%", "back\\"]) == "a 'b c' '$$X' 50%% 'back\\\\'"


def complaints(units):
    words = ["systemd-analyze", "verify", "--man=no", *map(str, units)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return [line for line in done.stderr.splitlines() if "rmr-corridor" in line]


@pytest.mark.real
@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd-analyze")
def test_systemd_verifies_the_units(tmp_path):
    export(tmp_path, "systemd")
    for path in (tmp_path / "out").glob("*/*.service"):  # it wants programs that are there
        path.write_text(path.read_text().replace("/opt/rmr/bin/", "/bin/true "))
    broken = tmp_path / "rmr-corridor-broken.service"
    broken.write_text("[Service]\nExecStrat=/bin/true\n")
    assert complaints([broken])
    for host in "abc":
        units = sorted((tmp_path / "out" / host).iterdir())
        assert complaints(units) == []
