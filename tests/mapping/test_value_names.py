"""Which names of raw values say that there is no value."""

import pytest

from rt_controller.mapping.value_names import stands_for_no_value

NO_VALUE = """
SNA; sna; Signal_SNA; SNA_8bit; Signal not available; NotAvailable; NOT_AVAILABLE;
notavailable; SignalNotAvailable; SIGNAL_NOT_AVAILABLE; n/a; N/A; Invalid; INVALID;
InvalidValue; Value invalid; invalid_0xFF; error; ERROR; Error; err; ERR; Sensor_Error;
SensorError; sensorerror; ErrorIndicator; fault; FAULT; Faulty; FaultDetected; SensorFault;
Fehler; FEHLER; Sensorfehler; fehlerhaft; failure; SystemFailure; init; INIT; Init_Value;
InitValue; initial; Initialwert; initializing; Initialising; Initialization; Initialisierung;
undefined; Undef; UNDEFINED; unknown; Unknown; UNKNOWN; Unbekannt; ungueltig; ungültig;
Signal_ungueltig; nicht verfügbar; nicht_verfuegbar; NichtVerfuegbar; no data; NoData;
NoDataExists; no signal; No_Signal; missing; Missing; out of range; OutOfRange; OUT_OF_RANGE;
outofrange; Not valid; Not_Valid; not initialized; Not_Initialised; Unavailable; kein Signal;
Not known; NODATA; Error 1; Error2; error (sensor); Failed; Not Available Error; SNA (signal
not available); Defekt; Error, not available
"""
VALUE = """
no error; NoError; No_Error; noerror; NO_ERROR; No error; error free; ErrorFree; error_free;
kein Fehler; Kein_Fehler; KeinFehler; keine Fehler; fehlerfrei; Fehlerfrei; no fault; NoFault;
NO_FAULT; nofault; fault free; without error; ohne Fehler; errorstate off; Error state off;
ErrorState_Off; Error inactive; Error_not_active; Error cleared; No sensor fault; not faulty;
Fault_None; default; Default; DEFAULT_MODE; mirror; OK; ok; valid; Valid; available; Available;
Signal available; On; Off; on; off; initialized; Initialised; P; R; N; D; Snapshot; SNAP;
Standstill; forward; Data ok; known; defined; in range; Init OK; 0 errors; Zero errors; not
invalid; no unknown; Nassau; National; Fehlerlos; kein interner Fehler; no failure; Error:
none; Good signal; max; Drive; Park; Neutral; Brake; range; No; Not pressed; not_braking; Yes;
Init_Done_OK
"""


def names(text):
    return [" ".join(each.split()) for each in text.split(";")]


@pytest.mark.parametrize(("text", "expected"), [(NO_VALUE, True), (VALUE, False)])
def test_a_name_without_a_value_is_told_from_others(text, expected):
    assert [name for name in names(text) if stands_for_no_value(name) is not expected] == []
