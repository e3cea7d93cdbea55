"""A client of the Language Server Protocol that starts `rmr lsp` and speaks to it over its pipes."""

import json
import os
import queue
import subprocess
import sys
import threading

PATIENCE_S = 60
"""How long a test waits for an answer: far longer than any takes on a busy machine."""
CAPABILITIES = {
    "general": {"positionEncodings": ["utf-16"]},
    "textDocument": {
        "publishDiagnostics": {"relatedInformation": True, "codeDescriptionSupport": True},
        "documentSymbol": {"hierarchicalDocumentSymbolSupport": True},
    },
    "workspace": {"workspaceEdit": {"documentChanges": True}},
}


class LspError(Exception):
    """The server has answered with an error."""


class LspClient:
    """One editor with its server."""

    def __init__(self, *words, **environment):
        code = "from rmr.cli import main; main()"
        self.process = subprocess.Popen(
            [sys.executable, "-c", code, "lsp", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=os.environ | {"RMR_COMPILED": ""} | environment,
        )
        self._messages = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._number = 0
        self.capabilities = None
        self.told = []
        """Notifications and requests of the server that nobody has asked for yet."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            stream.close()

    def _read(self):
        while True:
            length = 0
            while (line := self.process.stdout.readline()).strip():
                name, _, value = line.partition(b":")
                if name.lower() == b"content-length":
                    length = int(value)
            if not line:
                self._messages.put(None)
                return
            self._messages.put(json.loads(self.process.stdout.read(length)))

    # ---- messages

    def octets(self, octets):
        """Send octets as they are."""
        self.process.stdin.write(octets)
        self.process.stdin.flush()

    def send(self, value):
        """Send a JSON value as a message."""
        body = json.dumps(value).encode()
        self.octets(b"Content-Length: %d\r\n\r\n%b" % (len(body), body))

    def notify(self, method, **params):
        """Send a notification."""
        self.send({"jsonrpc": "2.0", "method": method, "params": params})

    def next(self):
        """Return the next message of the server; None if it has ended."""
        return self._messages.get(timeout=PATIENCE_S)

    def answer(self, number=None):
        """Return the next answer with this number; what comes before it is kept in `told`."""
        while True:
            message = self.next()
            assert message is not None, self.process.stderr.read().decode()
            if "method" not in message and message.get("id") == number:
                return message
            self.told.append(message)

    def request(self, method, **params):
        """Send a request; return its result, or raise LspError."""
        self._number += 1
        self.send({"jsonrpc": "2.0", "id": self._number, "method": method, "params": params or None})
        answer = self.answer(self._number)
        if "error" in answer:
            raise LspError(answer["error"]["message"])
        return answer["result"]

    # ---- what editors do

    def initialize(self, **changes):
        """Begin; `changes` replace parts of the client's capabilities."""
        result = self.request("initialize", processId=os.getpid(), rootUri=None, capabilities=CAPABILITIES | changes)
        self.notify("initialized")
        self.capabilities = result["capabilities"]
        return self

    def open(self, uri, text, version=1):
        """Open a text."""
        document = {"uri": uri, "languageId": "rmr", "version": version, "text": text}
        self.notify("textDocument/didOpen", textDocument=document)

    def change(self, uri, version, *changes):
        """Change a text: each change is a text, or a pair of positions and what replaces what is between them."""
        events = []
        for change in changes:
            if isinstance(change, str):
                events.append({"text": change})
            else:
                start, end, text = change
                events.append({"range": {"start": at(start), "end": at(end)}, "text": text})
        document = {"uri": uri, "version": version}
        self.notify("textDocument/didChange", textDocument=document, contentChanges=events)

    def diagnostics(self, uri, version=None):
        """Return the next diagnostics of a text, those of `version` if it is given."""
        while True:
            kept = [each for each in self.told if _is_published(each, uri, version)]
            if kept:
                self.told.remove(kept[0])
                return kept[0]["params"]["diagnostics"]
            message = self.next()
            assert message is not None, self.process.stderr.read().decode()
            self.told.append(message)

    def ask(self, method, uri, position=None, **more):
        """Send a request about a text, at a position."""
        place = {} if position is None else {"position": at(position)}
        return self.request(f"textDocument/{method}", textDocument={"uri": uri}, **place, **more)

    def end(self):
        """End in order; return the exit code and what the server has printed for people."""
        self.request("shutdown")
        self.notify("exit")
        self.process.wait(PATIENCE_S)
        return self.process.returncode, self.process.stderr.read().decode()


def at(position):
    """Return a position as the protocol has it."""
    line, character = position
    return {"line": line, "character": character}


def pair(position):
    """Return a position of the protocol as a pair."""
    return position["line"], position["character"]


def span(value):
    """Return the range of a value as two pairs."""
    return pair(value["range"]["start"]), pair(value["range"]["end"])


def _is_published(message, uri, version):
    params = message.get("params") or {}
    is_it = message.get("method") == "textDocument/publishDiagnostics" and params["uri"] == uri
    return is_it and (version is None or params.get("version") == version)
