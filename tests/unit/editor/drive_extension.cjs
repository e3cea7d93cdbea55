// Drives the extension for Visual Studio Code without the editor: `vscode` is what stands here, the server is real.
// node drive_extension.cjs EXTENSION COMMAND FOLDER; prints what came of it as JSON.
"use strict";
const Module = require("module");
const fs = require("fs");
const path = require("path");
const [extension, command, folder] = process.argv.slice(2);

const providers = {};
const commands = {};
const listeners = {};
const errors = [];
const logged = [];
const terminals = [];
const found = new Map();
class Position { constructor(line, character) { Object.assign(this, { line, character }); } }
class Range { constructor(a, b, c, d) { this.start = new Position(a, b); this.end = new Position(c, d); } }
class Location { constructor(uri, range) { Object.assign(this, { uri: uri.toString(), range }); } }
class Uri {
  constructor(text) { this.text = text; }
  static parse(text) { return new Uri(text); }
  get fsPath() { return decodeURIComponent(new URL(this.text).pathname); }
  toString() { return this.text; }
}
class WorkspaceEdit { constructor() { this.edits = []; } replace(uri, range, text) { this.edits.push([uri.toString(), range, text]); } }
const record = (...names) => class { constructor(...values) { names.forEach((name, k) => { this[name] = values[k]; }); } };
const listen = (name) => (listener) => { listeners[name] = listener; return { dispose() {} }; };
const provide = (name) => (_, provider) => { providers[name] = provider; return { dispose() {} }; };
const documents = [];
const vscode = {
  Position, Range, Location, Uri, WorkspaceEdit,
  Hover: record("contents", "range"), MarkdownString: record("value"), TextEdit: record("range", "newText"),
  Diagnostic: record("range", "message", "severity"), DiagnosticRelatedInformation: record("location", "message"),
  DiagnosticSeverity: { Error: 0, Warning: 1, Information: 2, Hint: 3 },
  DocumentSymbol: record("name", "detail", "kind", "range", "selectionRange"), DocumentHighlight: record("range"),
  CompletionItem: record("label", "kind"), CodeAction: record("title", "kind"), CodeActionKind: { QuickFix: "quickfix" },
  commands: { registerCommand: (name, run) => { commands[name] = run; return { dispose() {} }; } },
  window: {
    activeTextEditor: undefined,
    createOutputChannel: () => ({ appendLine: (line) => logged.push(line), dispose() {} }),
    createTerminal: (options) => ({ show() {}, sendText: (text) => terminals.push([options.cwd, text]) }),
    showErrorMessage: (message) => { errors.push(message); },
  },
  workspace: {
    textDocuments: documents,
    getConfiguration: () => ({ get: () => command }),
    createFileSystemWatcher: () => ({
      onDidCreate: listen("created"), onDidChange: listen("changed"), onDidDelete: listen("deleted"), dispose() {},
    }),
    onDidOpenTextDocument: listen("open"), onDidChangeTextDocument: listen("change"), onDidCloseTextDocument: listen("close"),
  },
  languages: {
    createDiagnosticCollection: () => ({ set: (uri, all) => found.set(uri.toString(), all), clear: () => found.clear(), dispose() {} }),
    registerHoverProvider: provide("hover"), registerDefinitionProvider: provide("definition"),
    registerReferenceProvider: provide("references"), registerDocumentHighlightProvider: provide("highlights"),
    registerDocumentSymbolProvider: provide("symbols"), registerCompletionItemProvider: provide("completion"),
    registerDocumentFormattingEditProvider: provide("formatting"), registerCodeActionsProvider: provide("actions"),
    registerRenameProvider: provide("rename"),
  },
};
const load = Module._load;
Module._load = (name, ...rest) => (name === "vscode" ? vscode : load(name, ...rest));

const until = async (is) => { while (!is()) await new Promise((done) => setTimeout(done, 10)); };

async function main() {
  const { activate, deactivate } = require(extension);
  const uri = Uri.parse(`file://${folder}/shop.rmr`);
  let text = "type !due(robot, int).\n/* \u{1F600} */ due(R, 1).\ndue(R, N) -> late(R, N).\n";
  const document = { uri, languageId: "rmr", version: 1, getText: () => text };
  documents.push(document, { uri: Uri.parse("file:///other.txt"), languageId: "plaintext" });
  const result = {};
  await activate({ subscriptions: [] });
  const about = (method, name, ...rest) => providers[name][method](document, ...rest);
  await until(() => found.get(uri.toString())?.length);
  result.diagnostics = found.get(uri.toString());
  const [action] = await about("provideCodeActions", "actions", new Range(2, 0, 2, 20), {}, undefined);
  result.action = [action.title, action.edit.edits];
  found.clear();
  text = text.replace("->", "-o");
  document.version = 2;
  listeners.change({ document, contentChanges: [{ range: new Range(2, 10, 2, 12), text: "-o" }] });
  await until(() => found.has(uri.toString()));
  result.mended = found.get(uri.toString()).map((each) => each.code.value);
  const there = new Position(1, 10);
  result.hover = (await about("provideHover", "hover", there)).contents.value;
  result.definition = await about("provideDefinition", "definition", there);
  result.references = (await about("provideReferences", "references", there, { includeDeclaration: true })).length;
  result.highlights = (await about("provideDocumentHighlights", "highlights", there)).length;
  result.symbols = (await about("provideDocumentSymbols", "symbols")).map((each) => each.name);
  result.completion = (await about("provideCompletionItems", "completion", new Position(2, 0))).map((each) => each.label);
  result.formatting = await about("provideDocumentFormattingEdits", "formatting", { tabSize: 2, insertSpaces: true });
  result.prepared = (await about("prepareRename", "rename", there)).placeholder;
  result.renamed = (await about("provideRenameEdits", "rename", there, "limit")).edits.length;
  result.refused = await about("provideRenameEdits", "rename", there, "Limit").catch((error) => error.message);
  commands["rmr.simulate"]();
  vscode.window.activeTextEditor = { document };
  commands["rmr.simulate"]();
  fs.writeFileSync(path.join(folder, "lab.yaml"), "");
  commands["rmr.simulate"]();
  result.terminals = terminals;
  found.clear();
  await commands["rmr.restart"]();
  await until(() => found.has(uri.toString()));
  listeners.close({ document });
  await deactivate();
  result.errors = errors;
  result.logged = logged;
  console.log(JSON.stringify(result));
}

main().catch((error) => { console.error(error); process.exit(1); });
