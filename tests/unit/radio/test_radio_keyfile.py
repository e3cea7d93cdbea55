"""The file with the radio's key: what is one, and what is said of what is none."""

import pytest

from rmr.radio.key_file import FILE_OCTETS_MAX, KeyFileError, read_key

DIGITS = "00112233445566778899aAbBcCdDeEfF"


@pytest.mark.parametrize(
    "text",
    [DIGITS, DIGITS + "\n", DIGITS.upper(), "\r\n\t".join(DIGITS), f"  {DIGITS[:16]}\n{DIGITS[16:]}  \n\n"],
)
def test_a_key_is_32_hexadecimal_digits_with_white_space_anywhere(tmp_path, text):
    (tmp_path / "lab.key").write_bytes(text.encode())
    assert read_key(tmp_path / "lab.key") == bytes.fromhex(DIGITS)


@pytest.mark.parametrize(
    ("octets", "what"),
    [
        (b"", "0 hexadecimal digits instead of 32"),
        (DIGITS[:-1].encode(), "31 hexadecimal digits instead of 32"),
        (DIGITS.encode() + b"0", "33 hexadecimal digits instead of 32"),
        (b"\n\n" + DIGITS[:-1].encode() + b"g", "line 3 has something else than hexadecimal digits"),
        (b"0x" + DIGITS.encode(), "line 1 has something else"),
        ("\N{ARABIC-INDIC DIGIT ZERO}".encode() * 32, "line 1 has something else"),
        (bytes(16), "line 1 has something else"),
        (b" " * FILE_OCTETS_MAX + DIGITS.encode(), f"more than {FILE_OCTETS_MAX} octets are no key"),
    ],
)
def test_invalid_key_file_is_reported_with_reason_and_remedy_and_without_the_key(tmp_path, octets, what):
    path = tmp_path / "lab.key"
    path.write_bytes(octets)
    with pytest.raises(KeyFileError) as wrong:
        read_key(path)
    message = str(wrong.value)
    assert message.startswith(f"{path}: {what}")
    assert message.endswith("to make a key: openssl rand -hex 16 > lab.key")
    assert DIGITS[:8] not in message.replace(str(tmp_path), "")


def test_unreadable_key_file_is_reported_with_reason_and_remedy(tmp_path):
    with pytest.raises(KeyFileError, match=r"none\.key: No such file or directory; to make a key: openssl"):
        read_key(tmp_path / "none.key")
    with pytest.raises(KeyFileError, match="Is a directory; to make a key"):
        read_key(tmp_path)
    with pytest.raises(KeyFileError, match="null byte"):
        read_key(tmp_path / "a\0b")
