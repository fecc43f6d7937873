"""Which names of raw values, in a DBC or a log, say that there is no value."""

import re

_FAULT = (
    r"(?:\w*(?<!no)(?<!non)(?<!kein)(?<!de)"
    r"(?:error|fault|fehler|failure|invalid|unknown|undef|ung(?:ü|ue)ltig)(?!free|frei|less|los)\w*"
    r"|err|failed|defekt?|init|initial|init\w*(?:ing|ation|isierung|value|wert)|missing|implausible"
    r"|unavail\w*|unbekannt)"
)
_NO_VALUE = re.compile(
    r"\b(?:sna|n a|not ?avail\w*|not (?:yet )?(?:valid|init\w*|defined|known)"
    r"|nicht (?:verf(?:ü|ue)gbar|g(?:ü|ue)ltig|init\w*|definiert|bekannt)"
    r"|no ?(?:data|signal|value)|keine? (?:daten|signal|wert)|out ?of ?range)\b"
)
_HEALTHY = re.compile(
    rf"\b(?:(?:no|non|0|zero|without|kein\w*|ohne)(?: \w+)?|not|nicht) {_FAULT}\b"
    rf"|\b{_FAULT}(?: \w+)* (?:free|frei|off|aus|none|0|inactive|inaktiv|cleared|ok|absent|false"
    r"|not active|not present|not detected|nicht aktiv|nicht vorhanden)\b"
)
_WORDS = re.compile(r"(?<=[a-zäöüß])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|(?<=\D)(?=\d)|[\s_:=/\\-]+")


def stands_for_no_value(text: str) -> bool:
    """True if a raw value has this name because the car then has no value.

    Fault or error with a negation ("no error", "fehlerfrei", "error off") is a healthy state.
    """
    words = " ".join(each for each in _WORDS.split(text) if each).lower()
    return bool(_NO_VALUE.search(words) or re.search(rf"\b{_FAULT}\b", _HEALTHY.sub("", words)))
