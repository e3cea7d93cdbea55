"""The extension for Visual Studio Code: its client against the real server, its grammar, its package."""

import json
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
from command_runner import invoke
from jsonschema import Draft202012Validator

from rmr import __version__
from rmr.lang.read.habits import AGGREGATES
from rmr.lang.read.lexer import scanner
from rmr.lang.read.tables import tables
from rmr_editor.highlight import TYPES, RmrLexer
from rmr_editor.main import command

ROOT = Path(__file__).parents[3]
EXTENSION = ROOT / "deploy" / "rmr_editor" / "vscode"
GRAMMAR = json.loads((EXTENSION / "rmr.tmLanguage.json").read_text("utf-8"))
PROGRAMS = sorted(path for folder in ("deploy", "docs", "tests") for path in (ROOT / folder).rglob("*.rmr"))
CACHE = ROOT / "build" / "npm-textmate"
PACKAGES = ("vscode-textmate@9.3.2", "vscode-oniguruma@2.0.1")
TOKENIZE = """
const fs = require("fs");
const { Registry, INITIAL, parseRawGrammar } = require("vscode-textmate");
const oniguruma = require("vscode-oniguruma");
const [grammar, ...files] = process.argv.slice(2);
async function main() {
  await oniguruma.loadWASM(fs.readFileSync(require.resolve("vscode-oniguruma/release/onig.wasm")).buffer);
  const registry = new Registry({
    onigLib: Promise.resolve({
      createOnigScanner: (patterns) => new oniguruma.OnigScanner(patterns),
      createOnigString: (text) => new oniguruma.OnigString(text),
    }),
    loadGrammar: async () => parseRawGrammar(fs.readFileSync(grammar, "utf8"), grammar),
  });
  const loaded = await registry.loadGrammar("source.rmr");
  const found = files.map((file) => {
    let stack = INITIAL;
    return fs.readFileSync(file, "utf8").split("\\n").map((line) => {
      const result = loaded.tokenizeLine(line, stack);
      stack = result.ruleStack;
      return result.tokens.map((token) => [line.slice(token.startIndex, token.endIndex), token.scopes.at(-1)]);
    });
  });
  console.log(JSON.stringify(found));
}
main();
"""

# ---- the grammar


def words_of(scope):
    """Return the words of the alternations of the grammar's patterns for a scope."""
    patterns = [each for each in GRAMMAR["repository"]["words"]["patterns"] if each["name"].startswith(scope)]
    found = [re.search(r"b\(?([a-z|]+)\)?\\b", each["match"]) for each in patterns]
    return {word for each in found if each is not None for word in each[1].split("|")}


def test_the_words_of_the_grammar_are_those_of_the_language():
    declared = words_of("keyword.declaration")
    assert declared | words_of("keyword.control") | {"list", "true", "false"} == set(scanner().reserved)
    assert words_of("constant.language") == {"true", "false"}
    assert words_of("storage.type") == TYPES | {"list"}
    assert words_of("support.function") == set(AGGREGATES)


def test_the_signs_of_the_grammar_are_those_of_the_language():
    patterns = "|".join(f"(?:{each['match']})" for each in GRAMMAR["repository"]["signs"]["patterns"])
    signs = {each.spelling for each in tables().terminals if each.spelling} - set(scanner().reserved)
    assert [
        sign for sign in sorted(signs | {"!=", "<>", "-o", "\u22b8", "-"}) if not re.fullmatch(patterns, sign)
    ] == []


@pytest.fixture(scope="module")
def textmate():
    """Return a function that gives the scopes of files by VS Code's own engine, which is installed once into build/."""
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        pytest.skip("npm or node is not installed")
    if not (CACHE / "node_modules" / "vscode-textmate").is_dir():
        CACHE.mkdir(parents=True, exist_ok=True)
        words = [npm, "install", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", str(CACHE), *PACKAGES]
        done = subprocess.run(words, capture_output=True, text=True, timeout=100, check=False)
        if done.returncode:
            pytest.skip(f"npm cannot install {PACKAGES}: {done.stderr.strip()[-200:]}")
    script = CACHE / "tokenize.cjs"
    script.write_text(TOKENIZE)

    def scopes(files):
        words = ["node", str(script), str(EXTENSION / "rmr.tmLanguage.json"), *map(str, files)]
        return json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)

    return scopes


SCOPES = {
    "Token.Comment.Single": "comment.line",
    "Token.Comment.Multiline": "comment.block",
    "Token.Keyword": "keyword.control",
    "Token.Keyword.Constant": "constant.language",
    "Token.Keyword.Declaration": "keyword.declaration",
    "Token.Keyword.Type": "storage.type",
    "Token.Literal.Number": "constant.numeric.time",
    "Token.Literal.Number.Float": "constant.numeric.rmr",
    "Token.Literal.Number.Integer": "constant.numeric.rmr",
    "Token.Literal.String.Double": "string",
    "Token.Name": "constant.other.symbol",
    "Token.Name.Builtin": "support.function",
    "Token.Name.Constant": "constant.other.robot",
    "Token.Name.Function": "entity.name.function",
    "Token.Name.Label": "entity.name.label",
    "Token.Name.Variable": "variable",
    "Token.Operator": "keyword.operator",
    "Token.Punctuation": "punctuation",
}
"""Tokens of Pygments, which are the compiler's, with the scopes of the grammar for them."""


@pytest.mark.slow
def test_the_grammar_sees_the_words_of_all_programs_as_the_compiler_does(textmate):
    seen = set()
    for path, lines in zip(PROGRAMS, textmate(PROGRAMS), strict=True):
        scopes = []  # one for each character that is no blank
        for line in lines:
            scopes += [(scope, letter) for text, scope in line for letter in text if not letter.isspace()]
        kinds = [
            (str(kind), letter)
            for _, kind, text in RmrLexer().get_tokens_unprocessed(path.read_text("utf-8"))
            for letter in text
            if not letter.isspace()
        ]
        assert [letter for _, letter in scopes] == [letter for _, letter in kinds], path
        for (scope, letter), (kind, _) in zip(scopes, kinds, strict=True):
            if kind != "Token.Error":
                seen.add(kind)
                is_escape = scope.startswith("constant.character.escape") and "String" in kind
                assert is_escape or scope.startswith(SCOPES[kind]), (path, letter, kind, scope)
    assert seen == set(SCOPES)


# ---- the client


@pytest.mark.medium
def test_the_client_does_what_the_server_can(tmp_path):
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    rmr = tmp_path / "rmr"
    rmr.write_text(f"#!{sys.executable}\nfrom rmr.cli import main\nmain()\n")
    rmr.chmod(0o755)
    driver = Path(__file__).with_name("drive_extension.cjs")
    words = ["node", str(driver), str(EXTENSION / "extension.js"), str(rmr), str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    [wrong] = result["diagnostics"]
    assert (wrong["message"], wrong["severity"], wrong["code"]["value"]) == ("unexpected `->`", 0, "E001")
    assert wrong["code"]["target"]["text"].endswith("/E001.md")
    assert wrong["range"]["start"] == {"line": 2, "character": 10}
    assert wrong["relatedInformation"][0]["message"] == "hint: a rule is written `body -o head.`"
    title, [[_, where, text]] = result["action"]
    assert (title, where, text) == ("write `-o`", wrong["range"], "-o")
    assert result["mended"] == []
    assert "type !due(robot, int)." in result["hover"]
    assert result["definition"][0]["range"]["start"] == {"line": 0, "character": 6}
    assert (result["references"], result["highlights"], result["renamed"]) == (3, 3, 3)
    assert result["symbols"] == ["due", "due(R, 1)", "due(R, N) -o late(R, N)."]
    assert {"due", "late", "moveto", "assert"} <= set(result["completion"])
    assert result["formatting"] == []
    assert result["prepared"] == "due"
    assert result["refused"].startswith("`Limit` is no name of a predicate")
    assert result["terminals"] == [[str(tmp_path), f"{rmr} sim ."]]
    assert (
        result["errors"]
        == ["RMR: open a lab.yaml, or a program that lies beside one; `rmr new NAME` writes a lab."] * 2
    )
    assert result["logged"] == []


@pytest.mark.medium
def test_a_command_that_is_not_there_is_told(tmp_path):
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    code = (
        "const Module = require('module'); const load = Module._load; const any = new Proxy(function () {}, {"
        " get: (_, name) => name === 'get' ? () => '/nowhere/rmr' : name === Symbol.iterator ? function* () {} :"
        " name === 'showErrorMessage' ? (text) => { console.log(text); process.exit(0); } : any, apply: () => any,"
        " construct: () => any });"
        "Module._load = (name, ...rest) => name === 'vscode' ? any : load(name, ...rest);"
        f"require({json.dumps(str(EXTENSION / 'extension.js'))}).activate({{ subscriptions: [] }});"
    )
    done = subprocess.run(["node", "-e", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout.startswith("RMR: there is no command /nowhere/rmr. It takes pip install 'rmr-robots[editor]'"), (
        done.stderr
    )


# ---- the package


def test_the_package_holds_what_it_names(tmp_path):
    target = tmp_path / "rmr.vsix"
    result = invoke(command, ["--vsix", str(target)])
    assert (result.exit_code, result.stderr) == (0, "")
    with zipfile.ZipFile(target) as archive:
        names = set(archive.namelist())
        package = json.loads(archive.read("extension/package.json"))
        schema = json.loads(archive.read("extension/lab.schema.json"))
        manifest = ElementTree.fromstring(archive.read("extension.vsixmanifest"))
        types = ElementTree.fromstring(archive.read("[Content_Types].xml"))
    contributed = package["contributes"]
    named = [package["main"], *(each["configuration"] for each in contributed["languages"])]
    named += [each["path"] for each in contributed["grammars"]] + [
        each["url"] for each in contributed["yamlValidation"]
    ]
    assert {f"extension/{each.removeprefix('./')}" for each in named} <= names
    assert package["version"] == __version__
    [identity] = [each for each in manifest.iter() if each.tag.endswith("Identity")]
    assert identity.attrib | {"Language": "en-US"} == {
        "Language": "en-US",
        "Id": package["name"],
        "Version": __version__,
        "Publisher": package["publisher"],
    }
    assets = [each.attrib["Path"] for each in manifest.iter() if each.tag.endswith("Asset")]
    assert set(assets) <= names
    known = {each.attrib["Extension"] for each in types}
    assert {Path(each).suffix for each in names - {"[Content_Types].xml"}} <= known
    Draft202012Validator.check_schema(schema)


def test_commands_of_the_menu_are_declared_and_registered():
    package = json.loads((EXTENSION / "package.json").read_text("utf-8"))
    declared = {each["command"] for each in package["contributes"]["commands"]}
    shown = {each["command"] for menu in package["contributes"]["menus"].values() for each in menu}
    registered = set(re.findall(r'registerCommand\("([^"]+)"', (EXTENSION / "extension.js").read_text("utf-8")))
    assert shown <= declared == registered


def test_a_place_that_cannot_be_written_is_wrong_usage(tmp_path):
    result = invoke(command, ["--vsix", str(tmp_path / "none" / "rmr.vsix")])
    assert result.exit_code == 2
    assert result.stderr.startswith(f"rmr lsp: cannot write {tmp_path}/none/rmr.vsix: No such file")
