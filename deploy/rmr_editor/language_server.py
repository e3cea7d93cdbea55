"""The language server: the messages of an editor, its texts, and what is said about them unasked.

pygls reads and writes the messages. What it says of itself goes nowhere: a message that is
broken is answered with one sentence, and so is a request that fails by a defect of ours.

After a change the server waits `QUIET_S` for more of them, then compiles in a thread, and publishes what is to be said
about every file. A request about a text waits until its compilation is there.
"""

import asyncio
import gc
import json
import logging
import os
import re
import stat
import sys
import threading
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from lsprotocol import types
from pygls.exceptions import FeatureRequestError, PyglsError
from pygls.io_ import StdoutWriter, run_async
from pygls.lsp.server import LanguageServer
from pygls.protocol import LanguageServerProtocol
from pygls.protocol.language_server import lsp_method
from pygls.uris import to_fs_path

import rmr
from rmr.entry import ExitCode
from rmr.lang.compiler import Compilation
from rmr.lang.diagnostics.diagnostic import CODES, Diagnostic, Severity
from rmr.lang.read.source_text import SourceText, Span
from rmr_editor.programs import Change, Programs, lines_of
from rmr_editor.symbols import Occurrence, SymbolIndex

QUIET_S = 0.005
"""How long no further change must come before a compilation begins: editors send those of one keystroke together."""
IDLE_S = 1.0
"""How long after a compilation garbage is looked for: there is hardly any, and the search takes half as long as a
compilation."""


class Protocol(LanguageServerProtocol):
    """pygls's protocol with answers to what is wrong, and with texts that `Programs` keeps."""

    _server: "Server"
    _has_refused = False
    """The message that is being read has been answered: it is no valid one."""

    def structure_message(self, data: dict[str, Any]) -> Any:
        """Return the message that a JSON object is; refuse one that is none."""
        if "jsonrpc" not in data:
            return data
        try:
            return super().structure_message(data)
        except Exception:
            self._refuse(data)
            return None  # it has been answered

    def handle_message(self, message: Any) -> None:
        """Handle a message; refuse what is none."""
        if message is None and self._has_refused:
            self._has_refused = False
        elif not hasattr(message, "jsonrpc"):
            self.answer(None, -32600, "this is no message of JSON-RPC 2.0")
        elif self._workspace is None and getattr(message, "method", "initialize") not in {"initialize", "exit"}:
            if hasattr(message, "id"):
                self.answer(message.id, -32002, "the first request is `initialize`")
        elif self._shutdown and hasattr(message, "id") and hasattr(message, "method"):
            self.answer(message.id, -32600, "the server has been shut down; what is left is `exit`")
        else:
            super().handle_message(message)

    def _refuse(self, data: dict[str, Any]) -> None:
        self._has_refused = True
        method = data.get("method")
        what = f"the parameters of `{method}`" if isinstance(method, str) else "this message"
        if "id" in data and "method" in data:
            number = data["id"] if isinstance(data["id"], int | str) else None
            self.answer(number, -32602, f"{what} are not those of the protocol")
        else:
            self._server.report_server_error(ValueError(f"{what} cannot be read"), PyglsError)

    def answer(self, number: int | str | None, code: int, sentence: str) -> None:
        """Answer a request, or what may have been one, with an error."""
        self._send_data({"jsonrpc": "2.0", "id": number, "error": {"code": code, "message": sentence}})

    def _send_response(self, msg_id: Any, result: Any = None, error: types.ResponseError | None = None) -> None:
        if error is not None:
            error.data = None  # a traceback
        super()._send_response(msg_id, result, error)

    @lsp_method(types.TEXT_DOCUMENT_DID_OPEN)
    def lsp_text_document__did_open(self, params: types.DidOpenTextDocumentParams) -> None:
        """Hold a text, in place of pygls's own copy."""
        document = params.text_document
        self._server.programs.open(document.uri, file_of(document.uri), document.text, document.version)
        self._server.changed()

    @lsp_method(types.TEXT_DOCUMENT_DID_CHANGE)
    def lsp_text_document__did_change(self, params: types.DidChangeTextDocumentParams) -> None:
        """Change a text."""
        document = params.text_document
        changes = [_change(each) for each in params.content_changes]
        if not self._server.programs.change(document.uri, document.version, changes):
            raise ValueError(f"{document.uri} has not been opened")
        self._server.changed()

    @lsp_method(types.TEXT_DOCUMENT_DID_CLOSE)
    def lsp_text_document__did_close(self, params: types.DidCloseTextDocumentParams) -> None:
        """Hold a text no longer."""
        self._server.programs.close(params.text_document.uri)
        self._server.changed()


def file_of(uri: str) -> str:
    """Return the name of a text in diagnostics: its path, or its URI if it is no file."""
    return (to_fs_path(uri) if uri.startswith("file:") else None) or uri


def _change(change: types.TextDocumentContentChangeEvent) -> Change:
    if isinstance(change, types.TextDocumentContentChangePartial):
        return Change(change.text, _pair(change.range.start), _pair(change.range.end))
    return Change(change.text)


def _pair(position: types.Position) -> tuple[int, int]:
    return position.line, position.character


class Server(LanguageServer):
    """The server of one editor."""

    def __init__(self) -> None:
        super().__init__("rmr", rmr.__version__, protocol_cls=Protocol)
        self.protocol: Protocol
        self.programs = Programs()
        self.ended_in_order = False
        """The editor has said that it is about to end."""
        self._compiling: asyncio.Task[None] | None = None
        self._collection: asyncio.TimerHandle | None = None
        self._published: set[str] = set()
        """URIs of files about which something has been said."""

    def report_server_error(self, error: Exception, source: Any) -> None:
        """Tell the editor what went wrong, in its log; the error of a request is its answer already."""
        if source is FeatureRequestError:
            return
        if isinstance(error, RecursionError | UnicodeDecodeError | json.JSONDecodeError):
            self.protocol.answer(None, -32700, "the message is no JSON in UTF-8")
            return
        text = re.sub(r"^\w+Error: ", "", str(error)).strip() or type(error).__name__
        sentence = text.splitlines()[0]
        self.window_log_message(types.LogMessageParams(types.MessageType.Error, f"rmr lsp: {sentence}"))

    # ---- compilations

    def changed(self) -> None:
        """See to it that what has changed is compiled."""
        if self._compiling is None or self._compiling.done():
            self._compiling = asyncio.create_task(self._compile())

    async def settled(self) -> None:
        """Wait until the compilations are those of the texts."""
        while not self.programs.settled and self._compiling is not None:
            await asyncio.shield(self._compiling)

    async def _compile(self) -> None:
        if self._collection is not None:
            self._collection.cancel()
        while not self.programs.settled:
            generation = -1
            while generation != self.programs.generation:
                generation = self.programs.generation
                await asyncio.sleep(QUIET_S)
            job = self.programs.job()
            try:
                roots = await asyncio.to_thread(job.run)
            except Exception as error:
                self.report_server_error(RuntimeError(f"a defect of the compiler: {error!r}"), PyglsError)
                roots = dict(job.kept)
            if self.programs.take(job, roots):
                try:
                    self._publish()
                except Exception as error:
                    self.report_server_error(RuntimeError(f"a defect of the server: {error!r}"), PyglsError)
        self._collection = asyncio.get_running_loop().call_later(IDLE_S, gc.collect)

    # ---- diagnostics

    def _publish(self) -> None:
        every = self.programs.diagnostics()
        for uri in [*every, *sorted(self._published - every.keys())]:
            found = every.get(uri, [])
            buffer = self.programs.buffer(uri)
            shown = [self.diagnostic(each, program) for each, program in found]
            version = None if buffer is None else buffer.version
            self.text_document_publish_diagnostics(types.PublishDiagnosticsParams(uri, shown, version))
        self._published = {uri for uri, found in every.items() if found}

    def diagnostic(self, each: Diagnostic, program: Compilation) -> types.Diagnostic:
        """Return a diagnostic as the protocol has it."""
        place = self.location(each.span, program)
        notes = [types.DiagnosticRelatedInformation(place, f"hint: {each.hint}")] if each.hint else []
        notes += [types.DiagnosticRelatedInformation(self.location(n.span, program), n.message) for n in each.notes]
        message = each.message
        if not self._shows_notes and each.hint:
            message += f"\nhint: {each.hint}"
        is_error = each.severity is Severity.ERROR
        return types.Diagnostic(
            range=place.range,
            message=message,
            severity=types.DiagnosticSeverity.Error if is_error else types.DiagnosticSeverity.Warning,
            code=each.code,
            code_description=types.CodeDescription(page_uri(each.code)),
            source="rmr",
            related_information=notes if notes and self._shows_notes else None,
        )

    @property
    def _shows_notes(self) -> bool:
        document = self.client_capabilities.text_document
        published = document and document.publish_diagnostics
        return bool(published and published.related_information)

    # ---- places

    async def named(self, uri: str, position: types.Position) -> "list[TextPlace]":
        """Return the place at a position of a text, once for each program that contains it."""
        await self.settled()
        found = []
        for program, source in self.programs.of(uri):
            offset = lines_of(source.text, self.programs.encoding).offset(*_pair(position))
            found.append(TextPlace(self.programs.index(program), source, offset))
        return found

    def locations(self, found: "Iterable[tuple[TextPlace, Occurrence]]") -> list[types.Location]:
        """Return where symbols are named, each place once."""
        every: dict[tuple[str, int, int], types.Location] = {}
        for place, each in found:
            where = self.location(each.span, place.index.program)
            every.setdefault((where.uri, each.span.start, each.span.end), where)
        return list(every.values())

    def location(self, span: Span, program: Compilation) -> types.Location:
        """Return a span as the protocol has it."""
        return types.Location(self.programs.uri(span.file), self.range(span, program))

    def range(self, span: Span, program: Compilation) -> types.Range:
        """Return the positions of a span."""
        start, end = self.programs.range(span, program)
        return types.Range(types.Position(*start), types.Position(*end))


@dataclass(frozen=True, slots=True)
class TextPlace:
    """A place of a text within one program."""

    index: SymbolIndex
    source: SourceText
    offset: int

    @property
    def occurrence(self) -> Occurrence | None:
        """What is named there."""
        return self.index.at(self.source.file, self.offset)


def page_uri(code: str) -> str:
    """Return where the page of a diagnostic code is."""
    assert code in CODES, code
    from rmr.lang import pages  # noqa: PLC0415 - for its folder alone

    return (Path(pages.__file__).parent / f"{code}.md").as_uri()


def made() -> Server:
    """Return a server that answers no questions yet."""
    server = Server()

    @server.feature(types.INITIALIZE)
    def initialize(ls: Server, _: types.InitializeParams) -> None:
        ls.programs.encoding = types.PositionEncodingKind(ls.workspace.position_encoding).value

    @server.feature(types.INITIALIZED)
    def initialized(ls: Server, _: types.InitializedParams) -> None:
        if _is_watching(ls.client_capabilities):
            watcher = types.FileSystemWatcher("**/*.rmr")
            options = types.DidChangeWatchedFilesRegistrationOptions([watcher])
            registration = types.Registration("rmr-files", types.WORKSPACE_DID_CHANGE_WATCHED_FILES, options)
            ls.client_register_capability(types.RegistrationParams([registration]))

    @server.feature(types.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    def on_disk(ls: Server, _: types.DidChangeWatchedFilesParams) -> None:
        ls.programs.on_disk()
        ls.changed()

    @server.feature(types.SHUTDOWN)
    def shutdown(ls: Server, _: None) -> None:
        ls.ended_in_order = True

    return server


def _is_watching(client: types.ClientCapabilities) -> bool:
    watched = client.workspace and client.workspace.did_change_watched_files
    return bool(watched and watched.dynamic_registration)


# ---- the process


def serve(server: Server) -> int:
    """Serve the editor at stdin and stdout; return the exit code."""
    logging.getLogger("pygls").addHandler(logging.NullHandler())
    logging.getLogger("pygls").propagate = False
    if sys.stdin is None or not _is_pipe(sys.stdin.fileno()):
        print("rmr lsp: an editor starts this command, with pipes as its stdin and stdout", file=sys.stderr)
        return ExitCode.USAGE
    # What anything else prints must not get between the messages.
    octets_out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    gc.freeze()
    gc.disable()  # see IDLE_S
    try:
        asyncio.run(_conversation(server, sys.stdin.buffer, octets_out))
    except SystemExit:
        pass  # how pygls takes `exit`
    except (OSError, ValueError, EOFError) as error:
        print(f"rmr lsp: the editor has broken off: {error}", file=sys.stderr)
        return ExitCode.FAILED
    return ExitCode.OK if server.ended_in_order else ExitCode.FAILED


def _is_pipe(descriptor: int) -> bool:
    mode = os.fstat(descriptor).st_mode
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)


async def _conversation(server: Server, octets_in: BinaryIO, octets_out: BinaryIO) -> None:
    """Handle messages until the editor says to exit, or closes the pipe."""
    # Not pygls's own reader: it waits in a thread, which Ctrl-C does not end.
    reader = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), octets_in)
    is_over = threading.Event()
    server.protocol.set_writer(MessageWriter(octets_out, is_over))
    await run_async(is_over, reader, server.protocol, logging.getLogger("pygls"), server.report_server_error)


class MessageWriter(StdoutWriter):
    """Writes messages until the editor reads none any more, which ends the conversation."""

    def __init__(self, stream: BinaryIO, is_over: threading.Event) -> None:
        super().__init__(stream)
        self._stream = stream
        self._is_over = is_over

    def write(self, data: bytes) -> None:
        """Write a message."""
        if self._is_over.is_set():
            return
        try:
            super().write(data)
        except OSError:
            self._is_over.set()

    def close(self) -> None:
        """Close the stream."""
        with suppress(OSError):
            self._stream.close()
