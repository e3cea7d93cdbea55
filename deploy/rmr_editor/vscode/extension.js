// The client of `rmr lsp` for Visual Studio Code, and the command that runs a lab in the simulator.
//
// The protocol is spoken here, over the pipes of the process, without a library: so the extension has no build step and
// nothing to download. Positions of VS Code are UTF-16 units, as the protocol's are by default.
"use strict";

const childProcess = require("child_process");
const fs = require("fs");
const path = require("path");
const vscode = require("vscode");

const RESTARTS_MAX = 3;
const SELECTOR = { language: "rmr" };
const SEVERITIES = [undefined, "Error", "Warning", "Information", "Hint"];

// ---- messages

class Connection {
  // Speaks JSON-RPC with a process; `told` is called with the server's notifications.
  constructor(command, told, ended) {
    this.told = told;
    this.waiting = new Map();
    this.number = 0;
    this.octets = Buffer.alloc(0);
    this.errors = "";
    this.process = childProcess.spawn(command, ["lsp"], { stdio: ["pipe", "pipe", "pipe"] });
    this.process.stdout.on("data", (octets) => this.read(octets));
    this.process.stderr.on("data", (octets) => { this.errors = (this.errors + octets).slice(-2000); });
    this.process.stdin.on("error", () => {}); // `exit` tells
    let isOver = false;
    const end = (reason) => {
      if (isOver) return;
      isOver = true;
      for (const { reject } of this.waiting.values()) reject(new Error(reason));
      this.waiting.clear();
      ended(reason);
    };
    this.process.on("error", (error) => end(error.code === "ENOENT" ? `there is no command ${command}` : error.message));
    this.process.on("exit", () => end(this.errors.trim().split("\n").pop() || "the language server has ended"));
  }

  send(message) {
    const body = Buffer.from(JSON.stringify({ jsonrpc: "2.0", ...message }));
    this.process.stdin.write(Buffer.concat([Buffer.from(`Content-Length: ${body.length}\r\n\r\n`), body]));
  }

  notify(method, params = {}) { this.send({ method, params }); }

  request(method, params, token) {
    const id = ++this.number;
    token?.onCancellationRequested(() => this.notify("$/cancelRequest", { id }));
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.send({ id, method, params });
    });
  }

  read(octets) {
    this.octets = Buffer.concat([this.octets, octets]);
    for (;;) {
      const end = this.octets.indexOf("\r\n\r\n");
      if (end < 0) return;
      const length = Number(/content-length: *(\d+)/i.exec(this.octets.toString("latin1", 0, end))?.[1] ?? 0);
      if (this.octets.length < end + 4 + length) return;
      const body = this.octets.toString("utf8", end + 4, end + 4 + length);
      this.octets = this.octets.subarray(end + 4 + length);
      this.handle(JSON.parse(body));
    }
  }

  handle(message) {
    if (message.method === undefined) {
      const { resolve, reject } = this.waiting.get(message.id) ?? {};
      this.waiting.delete(message.id);
      if (message.error) reject?.(new Error(message.error.message));
      else resolve?.(message.result ?? null);
    } else if (message.id === undefined) {
      this.told(message.method, message.params);
    } else {
      this.send({ id: message.id, error: { code: -32601, message: `${message.method} is not known here` } });
    }
  }
}

// ---- values of the protocol and of VS Code

const range = (r) => new vscode.Range(r.start.line, r.start.character, r.end.line, r.end.character);
const place = (p) => ({ line: p.line, character: p.character });
const span = (r) => ({ start: place(r.start), end: place(r.end) });
const location = (l) => new vscode.Location(vscode.Uri.parse(l.uri), range(l.range));
const markdown = (text) => new vscode.MarkdownString(text);

function diagnostic(d) {
  const made = new vscode.Diagnostic(range(d.range), d.message, vscode.DiagnosticSeverity[SEVERITIES[d.severity]]);
  made.source = d.source;
  made.code = { value: d.code, target: vscode.Uri.parse(d.codeDescription.href) };
  made.relatedInformation = (d.relatedInformation ?? []).map(
    (r) => new vscode.DiagnosticRelatedInformation(location(r.location), r.message));
  return made;
}

function workspaceEdit(edit) {
  const made = new vscode.WorkspaceEdit();
  for (const [uri, edits] of Object.entries(edit.changes ?? {}))
    for (const each of edits) made.replace(vscode.Uri.parse(uri), range(each.range), each.newText);
  return made;
}

// ---- the client

class Client {
  constructor(context) {
    this.output = vscode.window.createOutputChannel("RMR");
    this.found = vscode.languages.createDiagnosticCollection("rmr");
    this.restarts = 0;
    context.subscriptions.push(this.output, this.found, ...this.follow(), ...this.answer());
    this.start();
  }

  // The server knows every open text before it is asked about one: messages keep their order.
  start() {
    const command = vscode.workspace.getConfiguration("rmr").get("command") || "rmr";
    const connection = new Connection(command, (method, params) => this.told(method, params), (reason) => {
      if (this.connection !== connection) return;
      this.connection = undefined;
      this.found.clear();
      this.output.appendLine(reason);
      if (connection.isReady && this.restarts++ < RESTARTS_MAX) this.start();
      else vscode.window.showErrorMessage(`RMR: ${reason}. It takes pip install 'rmr-robots[editor]'; rmr.command may name its path.`);
    });
    this.connection = connection;
    const capabilities = {
      general: { positionEncodings: ["utf-16"] },
      textDocument: {
        publishDiagnostics: { relatedInformation: true, codeDescriptionSupport: true },
        documentSymbol: { hierarchicalDocumentSymbolSupport: true },
      },
    };
    this.ready = connection.request("initialize", { processId: process.pid, rootUri: null, capabilities }).then(() => {
      connection.isReady = true;
      connection.notify("initialized");
      for (const document of vscode.workspace.textDocuments) this.open(document);
    }, () => {});
    return this.ready;
  }

  async stop() {
    const connection = this.connection;
    this.connection = undefined;
    this.found.clear();
    if (connection === undefined) return;
    await connection.request("shutdown").catch(() => {});
    connection.notify("exit");
  }

  told(method, params) {
    if (method === "textDocument/publishDiagnostics")
      this.found.set(vscode.Uri.parse(params.uri), params.diagnostics.map(diagnostic));
    else if (method === "window/logMessage") this.output.appendLine(params.message);
  }

  // ---- texts

  notify(method, params) { if (this.connection?.isReady) this.connection.notify(method, params); }

  open(document) {
    if (document.languageId !== "rmr") return;
    const { version } = document;
    const textDocument = { uri: document.uri.toString(), languageId: "rmr", version, text: document.getText() };
    this.notify("textDocument/didOpen", { textDocument });
  }

  follow() {
    const changed = (type) => (uri) =>
      this.notify("workspace/didChangeWatchedFiles", { changes: [{ uri: uri.toString(), type }] });
    const watcher = vscode.workspace.createFileSystemWatcher("**/*.rmr");
    watcher.onDidCreate(changed(1));
    watcher.onDidChange(changed(2));
    watcher.onDidDelete(changed(3));
    return [
      watcher,
      vscode.workspace.onDidOpenTextDocument((document) => this.open(document)),
      vscode.workspace.onDidChangeTextDocument(({ document, contentChanges }) => {
        if (document.languageId !== "rmr" || contentChanges.length === 0) return;
        const textDocument = { uri: document.uri.toString(), version: document.version };
        const changes = contentChanges.map((each) => ({ range: span(each.range), text: each.text }));
        this.notify("textDocument/didChange", { textDocument, contentChanges: changes });
      }),
      vscode.workspace.onDidCloseTextDocument((document) => {
        if (document.languageId === "rmr")
          this.notify("textDocument/didClose", { textDocument: { uri: document.uri.toString() } });
      }),
    ];
  }

  // ---- requests

  async ask(method, document, token, more = {}) {
    await this.ready;
    if (this.connection === undefined) return null;
    return this.connection.request(`textDocument/${method}`, { textDocument: { uri: document.uri.toString() }, ...more }, token);
  }

  at(method, document, position, token, more = {}) {
    return this.ask(method, document, token, { position: place(position), ...more });
  }

  answer() {
    const { languages } = vscode;
    return [
      languages.registerHoverProvider(SELECTOR, {
        provideHover: async (document, position, token) => {
          const found = await this.at("hover", document, position, token);
          return found && new vscode.Hover(markdown(found.contents.value), found.range && range(found.range));
        },
      }),
      languages.registerDefinitionProvider(SELECTOR, {
        provideDefinition: async (...where) => (await this.at("definition", ...where) ?? []).map(location),
      }),
      languages.registerReferenceProvider(SELECTOR, {
        provideReferences: async (document, position, context, token) =>
          (await this.at("references", document, position, token, { context }) ?? []).map(location),
      }),
      languages.registerDocumentHighlightProvider(SELECTOR, {
        provideDocumentHighlights: async (...where) =>
          (await this.at("documentHighlight", ...where) ?? []).map((each) => new vscode.DocumentHighlight(range(each.range))),
      }),
      languages.registerDocumentSymbolProvider(SELECTOR, {
        provideDocumentSymbols: async (document, token) =>
          (await this.ask("documentSymbol", document, token) ?? []).map((each) => new vscode.DocumentSymbol(
            each.name, each.detail ?? "", each.kind - 1, range(each.range), range(each.selectionRange))),
      }),
      languages.registerCompletionItemProvider(SELECTOR, {
        provideCompletionItems: async (...where) =>
          (await this.at("completion", ...where.slice(0, 3)) ?? []).map((each) => {
            const made = new vscode.CompletionItem(each.label, each.kind - 1);
            made.detail = each.detail;
            made.documentation = each.documentation && markdown(each.documentation.value);
            return made;
          }),
      }),
      languages.registerDocumentFormattingEditProvider(SELECTOR, {
        provideDocumentFormattingEdits: async (document, options, token) =>
          (await this.ask("formatting", document, token, { options }) ?? []).map(
            (each) => new vscode.TextEdit(range(each.range), each.newText)),
      }),
      languages.registerCodeActionsProvider(SELECTOR, {
        provideCodeActions: async (document, where, context, token) => {
          const more = { range: span(where), context: { diagnostics: [], only: ["quickfix"] } };
          return (await this.ask("codeAction", document, token, more) ?? []).map((each) => {
            const made = new vscode.CodeAction(each.title, vscode.CodeActionKind.QuickFix);
            made.edit = workspaceEdit(each.edit);
            made.isPreferred = each.isPreferred;
            made.diagnostics = each.diagnostics.map(diagnostic);
            return made;
          });
        },
      }, { providedCodeActionKinds: [vscode.CodeActionKind.QuickFix] }),
      languages.registerRenameProvider(SELECTOR, {
        prepareRename: async (...where) => {
          const found = await this.at("prepareRename", ...where);
          return found && { range: range(found.range), placeholder: found.placeholder };
        },
        provideRenameEdits: async (document, position, newName, token) => {
          const edit = await this.at("rename", document, position, token, { newName });
          return edit && workspaceEdit(edit);
        },
      }),
    ];
  }
}

// ---- the simulator

// Run the lab of a text in a terminal: the folder is the terminal's own, so that no name has to be quoted.
function simulate() {
  const file = vscode.window.activeTextEditor?.document.uri.fsPath;
  const folder = file && path.dirname(file);
  if (!folder || !fs.existsSync(path.join(folder, "lab.yaml"))) {
    vscode.window.showErrorMessage("RMR: open a lab.yaml, or a program that lies beside one; `rmr new NAME` writes a lab.");
    return;
  }
  const command = vscode.workspace.getConfiguration("rmr").get("command") || "rmr";
  const terminal = vscode.window.createTerminal({ name: `rmr sim ${path.basename(folder)}`, cwd: folder });
  terminal.show();
  terminal.sendText(`${/^[\w./~-]+$/.test(command) ? command : `"${command}"`} sim .`);
}

let client;

function activate(context) {
  client = new Client(context);
  context.subscriptions.push(
    vscode.commands.registerCommand("rmr.simulate", simulate),
    vscode.commands.registerCommand("rmr.restart", async () => {
      await client.stop();
      client.restarts = 0;
      await client.start();
    }),
  );
  return client.ready;
}

function deactivate() { return client?.stop(); }

module.exports = { activate, deactivate };
