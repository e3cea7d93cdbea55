"""Programs over the whole grammar, drawn from its rules, and the layouts that they can be written in."""

from rmr.lang.read.grammar import grammar_text
from rmr.lang.read.table_maker import parser_of

GRAMMAR = parser_of(grammar_text())

WORDS = {
    "EXTREME": ["min", "max"],
    "NAME": ["p", "o", "online", "count", "moveto_the_farthest_place_of_all"],
    "VARIABLE": ["R", "_", "O", "_Left", "TheDistanceThatIsLeft"],
    "INT": ["1"],
    "FLOAT": ["2.5", "1e-3", "0.0625"],
    "TIME": ["500ms", "2s", "1.5min"],
    "ROBOT": ["@0", "@65533"],
    "STRING": ['""', '"a // b"', '"/* \\" , . "'],
    "ARROW": ["-o", "⊸"],
    "NE": ["!=", "<>"],
    "MINUS": ["-"],
}
"""The words that do not spell themselves in the grammar."""


def productions():
    """Return the right sides of each rule, the briefest first, and the words themselves."""
    rules = {}
    for rule in GRAMMAR.rules:
        origin = str(rule.origin.name)
        side = [str(symbol.name) for symbol in rule.expansion]
        if origin == "parameter":  # the tree builder accepts two names only before a type
            side = ["EXTREME" if symbol == "NAME" else symbol for symbol in side]
        rules.setdefault(origin, []).append(side)
    brief = dict.fromkeys([*WORDS, *(terminal.name for terminal in GRAMMAR.terminals)], 1)
    while not brief.keys() >= rules.keys():
        for name, sides in rules.items():
            known = [1 + sum(brief[symbol] for symbol in side) for side in sides if all(each in brief for each in side)]
            if known and name not in brief:
                brief[name] = min(known)
    for sides in rules.values():
        sides.sort(key=lambda side: sum(brief[symbol] for symbol in side))
    words = {terminal.name: [terminal.pattern.value] for terminal in GRAMMAR.terminals} | WORDS
    return rules, words


RULES, SPELT = productions()


def program(random, length):
    """Draw the words of a program; from `length` words on everything is said as briefly as possible."""
    words = []
    todo = ["item"] * random.randint(1, 3)
    while todo:
        symbol = todo.pop()
        if symbol in SPELT:
            words.append(random.choice(SPELT[symbol]))
        else:
            sides = RULES[symbol] if len(words) + len(todo) < length else RULES[symbol][:1]
            todo += reversed(random.choice(sides))
    return words


BLANKS = [" ", "\n", "\r\n", "\n\n \n", "\t ", "\ufeff", ""]
COMMENTS = [
    *(" // c\n", "\n// d. -o  \n", "//\n", " /* e */ ", "/* f */\n", "\n/* g */\n"),
    *("\n /* h */", "/* i\n  // i */", "/**/", "\r\n// j\r\n\r\n"),
]
TIGHT = set("()[]{},:")
"""Words that need no space around them."""


def written(words, random, comments):
    """Write `words` in a layout drawn at random; of the gaps between them the share `comments` has comments."""

    def gap():
        few = random.choices(BLANKS + COMMENTS, k=random.randint(1, 3))
        return "".join(few) if random.random() < comments else random.choice(BLANKS)

    text = gap()
    for word, following in zip(words, [*words[1:], ")"], strict=True):
        between = gap()
        apart = word not in TIGHT and (following not in TIGHT or between)  # `/` and `//` would be another comment
        text += word + " " * bool(apart and not between[:1].isspace()) + between
    return text
