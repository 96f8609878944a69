"""Forgeries of a signed certificate, and genuine ones: flipped bits, changes of the PDF's structure
in place and behind the signature, strangers' signatures over them.
"""

import io
import os
import random
import re
import warnings
from pathlib import Path

from calibkit import cli
from calibkit.certificate import sign
from calibkit.certificate.signing_key import PASSPHRASE, Key
from calibkit.errors import CalibkitError
from outputs import authority

ROOT = Path(__file__).resolve().parents[2]
PROFILE = ROOT / "reports" / "profiles" / "gyro_pair.toml"
STATED = 'adjustment.statement="no adjustment"'
WHITE = b"q 1 1 1 rg 50 300 500 400 re f Q\n"


def certified(folder, key):
    """Certificate of the sample gyro pair as `certify` writes it, signed with a key file; its DCC
    and `unsigned.pdf` lie beside it.
    """
    run = folder / "P" / "r001"
    stated = ("certify", run, "--profile", PROFILE, "--set", STATED)
    commands = (
        ("fit", "gyro_pair", "--data", ROOT / "datasets/gyro_pair", "--serial", "P"),
        (*stated, "--sign", key, "--out", folder / "certificate.pdf"),
        (*stated, "--out", folder / "unsigned.pdf"),
    )
    before = os.environ.get(PASSPHRASE)
    os.environ[PASSPHRASE] = authority.SECRET
    try:
        for command in commands:
            out = ("--out", folder) if command[0] == "fit" else ()
            try:
                cli.main([str(word) for word in (*command, *out, "--date", "2026-11-21")])
            except SystemExit as end:
                if end.code:
                    raise RuntimeError(f"{command[0]}: exit code {end.code}") from None
    finally:
        os.environ.pop(PASSPHRASE)
        if before is not None:
            os.environ[PASSPHRASE] = before
    return folder / "certificate.pdf"


def unsigned_part(document):
    """A certificate as it was before it was signed."""
    return document[: document.index(b"%%EOF") + 6]


def signed(document, key, role="", stamps="", now=authority.NOW):
    """The document with a signature by a key file more."""
    own = Key(key, authority.SECRET, now, stamps)
    return sign.sign_document(document, own.load_signer(), own, role).document


def stamped(document, url):
    """The document with a time stamp of all of it behind, by a server."""
    from pyhanko.sign import signers, timestamps

    stamper = signers.PdfTimeStamper(timestamps.HTTPTimeStamper(url))
    return stamper.timestamp_pdf(sign._open_for_update(document), "sha256").getvalue()


def flipped(document, count, seed):
    """Copies of a document with one bit flipped, a third of them within its signatures' own bytes;
    each with its name.
    """
    generator = random.Random(seed)  # noqa: S311 (a fixed seed, not a secret)
    own = [
        place
        for found in re.finditer(rb"/Contents <30", document)
        for place in range(found.start(), document.index(b"\nendobj", found.start()))
        if not document[place : place + 40].startswith(b"0" * 40)
    ]
    for _ in range(count):
        wanted = generator.random() < 1 / 3
        place = generator.choice(own) if wanted else generator.randrange(len(document))
        bit = generator.randrange(8)
        damaged = bytearray(document)
        damaged[place] ^= 1 << bit
        yield f"bit {bit} of byte {place}", bytes(damaged)


def _names(*parts):
    """PDF names of pypdf."""
    from pypdf.generic import NameObject

    return [NameObject(part) for part in parts]


def _stream(writer, content, **keys):
    """Reference to a new stream in a document."""
    from pypdf.generic import NameObject, StreamObject

    made = StreamObject()
    made.set_data(content)
    for key, value in keys.items():
        made[NameObject(f"/{key}")] = NameObject(f"/{value}")
    return writer._add_object(made)


def _dictionary(**keys):
    """PDF dictionary of names and texts."""
    from pypdf.generic import DictionaryObject, NameObject, TextStringObject

    return DictionaryObject(
        {
            NameObject(f"/{key}"): (
                NameObject(value)
                if isinstance(value, str) and value.startswith("/")
                else TextStringObject(value)
                if isinstance(value, str)
                else value
            )
            for key, value in keys.items()
        }
    )


def _boxed(writer):
    """A white box over the results."""
    from pypdf.generic import ArrayObject, NameObject

    page = writer.pages[0]
    own = page.raw_get("/Contents")
    page[NameObject("/Contents")] = ArrayObject([own, _stream(writer, WHITE)])


def _shadowed(writer):
    """Other content in the place of a page's."""
    from pypdf.generic import NameObject

    writer.pages[0][NameObject("/Contents")] = _stream(writer, WHITE)


def _annotated(writer, **keys):
    """An annotation on the first page."""
    from pypdf.generic import ArrayObject, FloatObject, NameObject

    box = ArrayObject([FloatObject(number) for number in (50, 300, 500, 700)])
    made = writer._add_object(_dictionary(Type="/Annot", Rect=box, **keys))
    page = writer.pages[0]
    page[NameObject("/Annots")] = ArrayObject([*page.get("/Annots", ()), made])


def _rooted(writer, key, value):
    """An entry of the catalog."""
    from pypdf.generic import NameObject

    writer._root_object[NameObject(key)] = value


def _without(writer, *keys):
    """The catalog without entries."""
    for key in keys:
        if key in writer._root_object:
            del writer._root_object[key]


def _unsigned(writer):
    """Everything that names the signature taken off."""
    _without(writer, "/AcroForm", "/Perms", "/DSS", "/Extensions")
    for page in writer.pages:
        if "/Annots" in page:
            del page["/Annots"]


def _cropped(writer):
    """A page that shows a part of itself."""
    from pypdf.generic import RectangleObject

    writer.pages[0].cropbox = RectangleObject((0, 0, 300, 300))


def _turned(writer):
    """A page turned round."""
    from pypdf.generic import NameObject, NumberObject

    writer.pages[0][NameObject("/Rotate")] = NumberObject(180)


def _attached(writer, name="gyro_scale.json", content=b"{}"):
    """Another file in the place of an attached one."""
    from pypdf.generic import DictionaryObject, NameObject

    for one in _files(writer):
        if one["/UF"] == name:
            made = _stream(writer, content, Type="EmbeddedFile")
            one[NameObject("/EF")] = DictionaryObject(
                {NameObject("/F"): made, NameObject("/UF"): made}
            )
    return writer


def _files(writer):
    """Records of the attached files."""
    listed = writer._root_object["/Names"]["/EmbeddedFiles"]
    return [entry.get_object() for entry in listed["/Names"][1::2]]


def _related(writer):
    """An attached file called something else than what it is."""
    from pypdf.generic import NameObject

    _files(writer)[0][NameObject("/AFRelationship")] = NameObject("/Unspecified")


def _detached(writer):
    """One attached file less."""
    listed = writer._root_object["/Names"]["/EmbeddedFiles"]["/Names"]
    del listed[:2]


def _retitled(writer):
    """Another number in the metadata."""
    writer.add_metadata({"/Title": "FORGED-2026-999"})


def _redescribed(writer):
    """Other metadata (XMP)."""
    made = _stream(writer, b"<x>FORGED-2026-999</x>", Type="Metadata", Subtype="XML")
    _rooted(writer, "/Metadata", made)


def _fielded(writer):
    """A field for text in the form."""
    from pypdf.generic import ArrayObject, NameObject

    form = writer._root_object.get("/AcroForm")
    if form is None:
        return
    form = form.get_object()
    made = writer._add_object(_dictionary(FT="/Tx", T="value", V="1.0"))
    form[NameObject("/Fields")] = ArrayObject([*form["/Fields"], made])


EDITS = {
    "nothing but saved": lambda writer: None,
    "metadata": _retitled,
    "XMP": _redescribed,
    "white box": _boxed,
    "shadow page": _shadowed,
    "free text": lambda w: _annotated(w, Subtype="/FreeText", Contents="K = 9999"),
    "square": lambda w: _annotated(w, Subtype="/Square"),
    "link": lambda w: _annotated(w, Subtype="/Link", A=_dictionary(S="/URI", URI="http://x")),
    "JavaScript": lambda w: _rooted(w, "/OpenAction", _dictionary(S="/JavaScript", JS="app.x")),
    "launch": lambda w: _rooted(w, "/OpenAction", _dictionary(S="/Launch", F="x.exe")),
    "crop box": _cropped,
    "turned page": _turned,
    "duplicated page": lambda w: w.add_page(w.pages[0]),
    "added page": lambda w: w.add_blank_page(),
    "deleted page": lambda w: w.remove_page(1),
    "AFRelationship": _related,
    "swapped attachment": _attached,
    "swapped DCC": lambda w: _attached(w, "dcc.xml", b"<a/>"),
    "added attachment": lambda w: w.add_attachment("accel_k.json", b"{}"),
    "removed attachment": _detached,
    "no AcroForm": lambda w: _without(w, "/AcroForm"),
    "no Perms": lambda w: _without(w, "/Perms"),
    "no signature": _unsigned,
    "field of text": _fielded,
    "layers": lambda w: _rooted(w, "/OCProperties", _dictionary(D=_dictionary(Name="x"))),
    "version": lambda w: _rooted(w, "/Version", _names("/2.0")[0]),
    "viewer preferences": lambda w: _rooted(
        w, "/ViewerPreferences", _dictionary(NonFullScreenPageMode="/UseOC")
    ),
}
"""What → change of a document open in pypdf's writer."""


def edited(document, what, *, behind):
    """The document with an edit: behind its end as an incremental update, or written anew."""
    from pypdf import PdfReader, PdfWriter

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reader = PdfReader(io.BytesIO(document))
        writer = PdfWriter(reader, incremental=True) if behind else PdfWriter(clone_from=reader)
        EDITS[what](writer)
        out = io.BytesIO()
        writer.write(out)
    return out.getvalue()


def packed(document):
    """The document written anew with its objects in compressed streams."""
    import pikepdf

    with warnings.catch_warnings(), pikepdf.open(io.BytesIO(document)) as pdf:
        warnings.simplefilter("ignore")
        out = io.BytesIO()
        pdf.save(out, object_stream_mode=pikepdf.ObjectStreamMode.generate)
    return out.getvalue()


def _contents(document):
    """Where the value of the last signature begins and ends."""
    first = document.rindex(b"/Contents <30") + len(b"/Contents ")
    return first, document.index(b">", first) + 1


def bytewise(document, other):
    """Changes of the bytes of a signed document; `other` is another signed one."""
    first, last = _contents(document)
    one, two = _contents(other)
    foreign = other[one:two][1:-1].rstrip(b"0").ljust(last - first - 2, b"0")
    zeroed = b"<" + b"0" * (last - first - 2) + b">"
    found = re.search(rb"/ByteRange ?\[[^]]*\]", document)
    start, stop = found.span()
    renamed = document.replace(b"/ByteRange", b"/ByteRangd")
    yield "ByteRange renamed by one bit", renamed
    yield "the same and a white box", edited(renamed, "white box", behind=True)
    yield "the same, written anew", packed(edited(renamed, "white box", behind=False))
    yield "a byte behind", document + b"\n"
    yield "bytes behind", document + b"\n1 0 obj\n<< >>\nendobj\n"
    yield "the end twice", document + b"\nstartxref\n0\n%%EOF\n"
    yield "itself twice", document + document
    yield "another behind", document + other
    yield "a prefix", b"%!PS\n" + document
    yield "a whole PDF before", other + document
    yield "zeroed signature", document[:first] + zeroed + document[last:]
    yield "foreign signature", document[:first] + b"<" + foreign + b">" + document[last:]
    yield "capital digits", document[: last - 9] + b"A" + document[last - 8 :]
    yield (
        "a short ByteRange",
        document[:start] + b"/ByteRange [0 9]".ljust(stop - start) + document[stop:],
    )
    yield "no ByteRange", document[:start] + b" " * (stop - start) + document[stop:]
    yield "a name with an escape", document.replace(b"/SubFilter", b"/Sub#46ilter")
    yield "cut in the signature", document[: (first + last) // 2]
    yield "cut behind the signature", document[: last + 20]
    yield "cut in half", document[: len(document) // 2]
    yield "the last byte cut", document[:-1]
    yield "the last line cut", document[: document.rstrip().rindex(b"\n") + 1]


def forgeries(document, other, stranger):
    """At least 100 changes of the structure of a signed document, each with its name; `stranger` is
    the key file of somebody else.
    """
    yield from bytewise(document, other)
    for what in EDITS:
        behind = edited(document, what, behind=True)
        anew = edited(document, what, behind=False)
        if behind != document:
            yield f"{what}, behind", behind
            yield f"{what}, behind, signed by a stranger", _resigned(behind, stranger)
        yield f"{what}, written anew", anew
        yield f"{what}, in compressed streams", packed(anew)


def _resigned(document, stranger):
    """The document with a stranger's signature over what it is, where one can be put on it."""
    try:
        return signed(document, stranger, "approved")
    except (CalibkitError, ValueError, KeyError):
        return document
    except Exception as error:
        if type(error).__module__.startswith("pyhanko"):
            return document
        raise


def genuine(plain, folder, url, stamps, count):
    """Certificates that are what they claim to be, each with what `verify` is asked: keys of three
    kinds, with and without time stamps of the server at `url`, one to three signatures; every fifth
    was signed five years ago by a key whose certificate has expired since.
    """
    own = authority.Authority("Genuine authority", 600)
    roots = (own.write(folder / "genuine.pem"), stamps.write(folder / "stamps.pem"))
    for number in range(count):
        old, kind = number % 5 == 4, ("rsa2048", "p256", "rsa3072")[number % 3]
        days = (-2200, -1400) if old else (-10, 1000)
        usage = (None, authority.SIGNING, ("digital_signature",))[number % 3 - 1]
        key = own.issue(folder / "own.p12", f"Laboratory {number}", kind, days, usage=usage)
        stamped = number % 2 == 0
        now = authority.THEN if old else authority.NOW
        place = f"{url}/{'then' if old else 'tsa'}" if stamped else ""
        document = plain
        for role in ("", "checked", "approved")[: 1 + number % 3]:
            document = signed(document, key, role, place, now)
        demands = {"trust": roots}
        if old and not stamped:
            demands["at"] = now.date()
        yield document, demands
