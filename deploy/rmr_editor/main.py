"""The command `rmr lsp`: the server, or the extension for Visual Studio Code as one file.

The extension is the folder `vscode` beside this module, which has no build step. What it is packed with depends on the
release: its version, and the schema of the lab file.
"""
# ruff: noqa: PLC0415 - see rmr.entry

import sys
from collections.abc import Sequence
from pathlib import Path

from rmr.entry import ExitCode, run
from rmr.entry.command_line import Command, Parser

ABOUT = """\
Serve an editor over the Language Server Protocol: on stdin and stdout, until it says to exit.

With --vsix write the extension for Visual Studio Code, which does so, and end.

Editors start this command themselves: docs/editor.md says how they are set up. It needs pygls, which
pip install 'rmr-robots[editor]' brings.
"""


VSIX_MANIFEST = """\
<?xml version="1.0" encoding="utf-8"?>
<PackageManifest Version="2.0.0" xmlns="http://schemas.microsoft.com/developer/vsx-schema/2011">
  <Metadata>
    <Identity Language="en-US" Id="{name}" Version="{version}" Publisher="{publisher}"/>
    <DisplayName>{displayName}</DisplayName>
    <Description xml:space="preserve">{description}</Description>
    <Categories>Programming Languages,Linters,Formatters</Categories>
    <Properties>
      <Property Id="Microsoft.VisualStudio.Code.Engine" Value="{engine}"/>
    </Properties>
  </Metadata>
  <Installation><InstallationTarget Id="Microsoft.VisualStudio.Code"/></Installation>
  <Dependencies/>
  <Assets>
    <Asset Type="Microsoft.VisualStudio.Code.Manifest" Path="extension/package.json" Addressable="true"/>
    <Asset Type="Microsoft.VisualStudio.Services.Content.Details" Path="extension/README.md" Addressable="true"/>
  </Assets>
</PackageManifest>
"""
VSIX_TYPES = """\
<?xml version="1.0" encoding="utf-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
  <Default Extension=".json" ContentType="application/json"/>
  <Default Extension=".js" ContentType="application/javascript"/>
  <Default Extension=".md" ContentType="text/markdown"/>
  <Default Extension=".vsixmanifest" ContentType="text/xml"/>
</Types>
"""


def _declare(parser: Parser) -> None:
    parser.option("--vsix", metavar="FILE", read=Path, help="Write the extension for Visual Studio Code to FILE.")
    parser.flag("--stdio", help="Accepted because some editors say so; there is no other way.")


def _serve(vsix: Path | None, stdio: bool) -> int:  # noqa: ARG001 - there is no other way
    if vsix is not None:
        return _packed(vsix)
    from rmr_editor.answers import answering
    from rmr_editor.language_server import serve

    return serve(answering())


def _packed(target: Path) -> int:
    """Write the extension as one file; return the exit code."""
    import json
    import zipfile
    from xml.sax.saxutils import escape

    from rmr import __version__
    from rmr_world.schema import json_schema

    folder = Path(__file__).with_name("vscode")
    files = {each.name: each.read_text("utf-8") for each in sorted(folder.iterdir()) if each.is_file()}
    package = json.loads(files["package.json"]) | {"version": __version__}
    files |= {"package.json": json.dumps(package, indent=2), "lab.schema.json": json.dumps(json_schema())}
    told = {name: escape(value) for name, value in package.items() if isinstance(value, str)}
    manifest = VSIX_MANIFEST.format(**told, engine=package["engines"]["vscode"])
    try:
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("extension.vsixmanifest", manifest)
            archive.writestr("[Content_Types].xml", VSIX_TYPES)
            for name, text in files.items():
                archive.writestr(f"extension/{name}", text)
    except OSError as error:
        print(f"rmr lsp: cannot write {target}: {error.strerror or error}", file=sys.stderr)
        return ExitCode.USAGE
    print(f"{target}; install it with: code --install-extension {target}")
    return ExitCode.OK


command = Command(ABOUT, _declare, _serve)


def main(words: Sequence[str] | None = None, name: str = "rmr lsp") -> int:
    """Run `rmr lsp`; return its exit code."""
    return run(name, lambda: command.main(words, name))


if __name__ == "__main__":
    sys.exit(main())
