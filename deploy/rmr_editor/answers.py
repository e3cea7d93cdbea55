"""Answers to an editor's requests: `programs` and `symbols` in the words of the protocol."""

from collections.abc import Callable, Iterable, Iterator

from lsprotocol import types
from pygls.exceptions import JsonRpcException

from rmr.lang.compiler import Compilation
from rmr.lang.diagnostics.diagnostic import Diagnostics, Fix
from rmr.lang.format import format_source
from rmr.lang.read.source_text import SourceText
from rmr_editor.language_server import Server, TextPlace, made
from rmr_editor.programs import lines_of
from rmr_editor.symbols import Named, Occurrence, SymbolIndex, included_at, outline


def answering() -> Server:
    """Return a server that answers all requests."""
    server = made()
    _answer_about_names(server)
    _answer_about_texts(server)
    _answer_with_edits(server)
    return server


def _answer_about_names(server: Server) -> None:
    @server.feature(types.TEXT_DOCUMENT_HOVER)
    async def hover(ls: Server, params: types.HoverParams) -> types.Hover | None:
        for place in await ls.named(params.text_document.uri, params.position):
            found = place.occurrence
            text = place.index.described(found) if found is not None else None
            text = text or place.index.serving(place.source.file, place.offset)
            if text is not None:
                where = ls.range(found.span, place.index.program) if found is not None else None
                return types.Hover(types.MarkupContent(types.MarkupKind.Markdown, text), where)
        return None

    @server.feature(types.TEXT_DOCUMENT_DEFINITION)
    async def definition(ls: Server, params: types.DefinitionParams) -> list[types.Location]:
        places = await ls.named(params.text_document.uri, params.position)
        for place in places:
            file = included_at(place.source, place.offset)
            if file is not None:
                start = types.Position(0, 0)
                return [types.Location(ls.programs.uri(file), types.Range(start, start))]
        return ls.locations(_everywhere(places, SymbolIndex.definitions))

    @server.feature(types.TEXT_DOCUMENT_REFERENCES)
    async def references(ls: Server, params: types.ReferenceParams) -> list[types.Location]:
        found = _everywhere(await ls.named(params.text_document.uri, params.position), SymbolIndex.all)
        return ls.locations(each for each in found if params.context.include_declaration or not each[1].declares)

    @server.feature(types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
    async def highlight(ls: Server, params: types.DocumentHighlightParams) -> list[types.DocumentHighlight]:
        uri = params.text_document.uri
        found = ls.locations(_everywhere(await ls.named(uri, params.position), SymbolIndex.all))
        return [types.DocumentHighlight(each.range) for each in found if each.uri == uri]


def _everywhere(
    places: "list[TextPlace]", found: Callable[[SymbolIndex, Named], list[Occurrence]]
) -> "Iterator[tuple[TextPlace, Occurrence]]":
    """Yield the occurrences of what each place names."""
    for place in places:
        occurrence = place.occurrence
        if occurrence is not None:
            yield from ((place, each) for each in found(place.index, occurrence.symbol))


def _answer_about_texts(server: Server) -> None:
    @server.feature(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    async def symbols(
        ls: Server, params: types.DocumentSymbolParams
    ) -> list[types.DocumentSymbol] | list[types.SymbolInformation]:
        await ls.settled()
        uri = params.text_document.uri
        for program, source in ls.programs.of(uri):
            found = [(each, ls.range(each.span, program)) for each in outline(program, source.file)]
            if not _takes_trees(ls.client_capabilities):
                return [
                    types.SymbolInformation(types.Location(uri, where), each.name, SYMBOL_KINDS[each.what])
                    for each, where in found
                ]
            return [
                types.DocumentSymbol(each.name, SYMBOL_KINDS[each.what], where, ls.range(each.head, program), each.what)
                for each, where in found
            ]
        return []

    @server.feature(types.TEXT_DOCUMENT_COMPLETION)
    async def completion(ls: Server, params: types.CompletionParams) -> list[types.CompletionItem]:
        for place in await ls.named(params.text_document.uri, params.position):
            return [
                types.CompletionItem(
                    each.word,
                    kind=COMPLETION_KINDS[each.what],
                    detail=each.detail or each.what,
                    documentation=types.MarkupContent(types.MarkupKind.Markdown, each.doc) if each.doc else None,
                )
                for each in place.index.suggestions(place.source.file, place.offset)
            ]
        return []


def _answer_with_edits(server: Server) -> None:
    @server.feature(types.TEXT_DOCUMENT_PREPARE_RENAME)
    async def rename_what(ls: Server, params: types.PrepareRenameParams) -> types.PrepareRenamePlaceholder:
        places = await ls.named(params.text_document.uri, params.position)
        place, occurrence = _to_rename(places)
        return types.PrepareRenamePlaceholder(ls.range(occurrence.span, place.index.program), occurrence.symbol.name)

    @server.feature(types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))
    async def rename(ls: Server, params: types.RenameParams) -> types.WorkspaceEdit:
        places = await ls.named(params.text_document.uri, params.position)
        _to_rename(places)
        for place in places:
            why = None if place.occurrence is None else place.index.why_not(place.occurrence.symbol, params.new_name)
            if why is not None:
                raise refused(why)
        found = ls.locations(_everywhere(places, SymbolIndex.all))
        return _edit(ls, [(each.uri, types.TextEdit(each.range, params.new_name)) for each in found])

    @server.feature(types.TEXT_DOCUMENT_CODE_ACTION, types.CodeActionOptions([types.CodeActionKind.QuickFix]))
    async def fixes(ls: Server, params: types.CodeActionParams) -> list[types.CodeAction]:
        await ls.settled()
        uri = params.text_document.uri
        if params.context.only and types.CodeActionKind.QuickFix not in params.context.only:
            return []
        found = [(each, program) for each, program in ls.programs.diagnostics().get(uri, []) if each.fix is not None]
        return [
            _fixed(ls, each.fix, ls.diagnostic(each, program), program)
            for each, program in found
            if each.fix is not None and _meet(ls.range(each.span, program), params.range)
        ]

    @server.feature(types.TEXT_DOCUMENT_FORMATTING)
    def formatting(ls: Server, params: types.DocumentFormattingParams) -> list[types.TextEdit] | None:
        buffer = ls.programs.buffer(params.text_document.uri)
        text = None if buffer is None else format_source(SourceText(buffer.file, buffer.text), Diagnostics())
        if buffer is None or text is None:
            return None  # it has syntax errors, which its diagnostics tell
        change = replaced(buffer.text, text)
        if change is None:
            return []
        start, end, new = change
        lines = lines_of(buffer.text, ls.programs.encoding)
        first, last = (types.Position(*lines.position(each)) for each in (start, end))
        return [types.TextEdit(types.Range(first, last), new)]


def refused(sentence: str) -> JsonRpcException:
    """Return the error that refuses a request with one sentence."""
    return JsonRpcException(sentence, types.LSPErrorCodes.RequestFailed.value)


def _to_rename(places: list[TextPlace]) -> tuple[TextPlace, Occurrence]:
    """Return what is to get another name; refuse if nothing may."""
    for place in places:
        occurrence = place.occurrence
        if occurrence is not None:
            why = place.index.why_fixed(occurrence.symbol)
            if why is not None:
                raise refused(why)
            return place, occurrence
    raise refused("here is no name of a predicate, action, function, constant or variable")


def _fixed(ls: Server, fix: Fix, diagnostic: types.Diagnostic, program: Compilation) -> types.CodeAction:
    place = ls.location(fix.span, program)
    old = program.sources[fix.span.file].text[fix.span.start : fix.span.end]
    new = " ".join(fix.text.split())
    title = f"delete `{old}`" if not new else f"insert `{new}`" if not old else f"write `{new}`"
    edit = _edit(ls, [(place.uri, types.TextEdit(place.range, fix.text))])
    kind = types.CodeActionKind.QuickFix
    return types.CodeAction(title, kind, diagnostics=[diagnostic], is_preferred=True, edit=edit)


def _meet(one: types.Range, other: types.Range) -> bool:
    return one.start <= other.end and other.start <= one.end


def _edit(ls: Server, edits: list[tuple[str, types.TextEdit]]) -> types.WorkspaceEdit:
    """Return edits of several texts, with their versions if the editor checks these."""
    texts: dict[str, list[types.TextEdit]] = {}
    for uri, each in edits:
        texts.setdefault(uri, []).append(each)
    workspace = ls.client_capabilities.workspace
    if not (workspace and workspace.workspace_edit and workspace.workspace_edit.document_changes):
        return types.WorkspaceEdit(changes=texts)
    changes = []
    for uri, every in texts.items():
        buffer = ls.programs.buffer(uri)
        version = None if buffer is None else buffer.version
        changes.append(types.TextDocumentEdit(types.OptionalVersionedTextDocumentIdentifier(uri, version), [*every]))
    return types.WorkspaceEdit(document_changes=[*changes])


def replaced(old: str, new: str) -> tuple[int, int, str] | None:
    """Return where the lines of `old` differ from those of `new`, and what replaces them; None if they do not."""
    if old == new:
        return None
    lines, others = old.splitlines(keepends=True), new.splitlines(keepends=True)
    same = _common(lines, others)
    same_last = _common(lines[same:][::-1], others[same:][::-1])
    start = sum(map(len, lines[:same]))
    end = len(old) - sum(map(len, lines[len(lines) - same_last :]))
    return start, end, "".join(others[same : len(others) - same_last])


def _common(one: Iterable[str], other: Iterable[str]) -> int:
    count = 0
    for a, b in zip(one, other, strict=False):
        if a != b:
            break
        count += 1
    return count


def _takes_trees(client: types.ClientCapabilities) -> bool:
    shown = client.text_document and client.text_document.document_symbol
    return bool(shown and shown.hierarchical_document_symbol_support)


SYMBOL_KINDS = {
    "predicate": types.SymbolKind.Struct,
    "action": types.SymbolKind.Method,
    "function": types.SymbolKind.Function,
    "constant": types.SymbolKind.Constant,
    "assertion": types.SymbolKind.Event,
    "goal": types.SymbolKind.Key,
    "fact": types.SymbolKind.Object,
    "rule": types.SymbolKind.Operator,
}
"""What an item of an outline is, in the protocol's words."""
COMPLETION_KINDS = {
    "predicate": types.CompletionItemKind.Struct,
    "action": types.CompletionItemKind.Method,
    "function": types.CompletionItemKind.Function,
    "constant": types.CompletionItemKind.Constant,
    "variable": types.CompletionItemKind.Variable,
    "keyword": types.CompletionItemKind.Keyword,
    "file": types.CompletionItemKind.File,
}
"""What a suggestion is, in the protocol's words."""
