"""
Every text that the console shows and race control did not write, in one place.

Sentences of race control (reasons, answers, alerts, events) are shown as they come.
"""

from __future__ import annotations

from evgp_rcs_console.snapshot import Command, Kart, State, Track

TITLE = 'EVGP race control'

STATES = {
    State.UNKNOWN: '',
    State.IN_GARAGE: 'IN GARAGE',
    State.GRID_ACTIVE: 'GRID ACTIVE',
    State.GREEN_GREEN: 'GREEN GREEN',
    State.RED_FLAG: 'RED FLAG',
    State.RED_RED: 'RED RED',
}

SYMBOLS = {
    State.UNKNOWN: '?',
    State.IN_GARAGE: '⌂',
    State.GRID_ACTIVE: '▦',
    State.GREEN_GREEN: '▶',
    State.RED_FLAG: '⚑',
    State.RED_RED: '■',
}
"""A state is told by its word and its symbol, never by its colour alone."""

LABELS = {
    Command.ALL_KILL: 'ALL KILL',
    Command.RED_FLAG: 'RED FLAG',
    Command.GRID_ACTIVE: 'GRID ACTIVE',
    Command.GREEN_GREEN: 'GREEN GREEN',
    Command.RACE_OVER: 'RACE OVER',
    Command.IN_GARAGE: 'IN GARAGE',
    Command.OPEN_TRACK: 'OPEN TRACK',
    Command.CLOSE_TRACK: 'CLOSE TRACK',
    Command.RECORD_MSR: 'MSR WAS USED',
    Command.KART_RED_RED: 'RED RED',
    Command.KART_RED_FLAG: 'RED FLAG',
    Command.KART_FINISH: 'FINISH',
    Command.KART_IN_GARAGE: 'GARAGE',
    Command.JOIN_RACE: 'JOIN',
    Command.LEAVE_RACE: 'LEAVE',
}

IN_RACE = 'IN RACE'
ALL_KARTS = 'ALL KARTS'
COLUMNS = ('Kart', 'Team', 'Race', 'Link', 'Is sent', 'Since', 'Acknowledged', 'Says', 'Place', '')
HEADINGS = {
    'number': 'Kart',
    'team': 'Team, why it is held',
    'race': 'Race, link',
    'sent': 'Is sent, since',
    'acknowledged': 'Acknowledged, says',
    'place': 'Place',
    'buttons': 'Commands to this kart',
}
RACING = '● in race'
NOT_RACING = '○ out'
LINKED = '✓ linked'
NOT_LINKED = '✗ NO LINK'
MAY_MOVE = 'may be moving'
HELD = 'held: {reason}'
YES = '✓ yes'
WAITING = '… not yet'
NOTHING_ASKED = '-'
OVER = 'race over'

HUMANS_ALLOWED = '✓ HUMANS ALLOWED'
HUMANS_NOT_ALLOWED = '✗ NO HUMANS ON TRACK'
TRACK_OPEN = 'Track is OPEN'
TRACK_CLOSED = 'Track is closed'

NO_ALERT = '✓ No alerts'
SEEN = 'SEEN'
SEEN_ALL = 'ALL SEEN'
ALERTS = 'Alerts: {told}'
ALERTS_NEW = '{count} new'
ALERTS_SEEN = '{count} seen, still there'
ALERTS_ENDED = '{count} ended'
MORE_MSR = 'not shown: USE THE MSR, kart {karts}'
MORE_OTHER = 'not shown: kart {karts}'
NO_SINGLE_KART = 'none in particular'
ALERT_MSR = '⚠ USE THE MSR'
ALERT_OTHER = '! ALERT'
ALERT_ENDED = 'ENDED'
MSR_PREFIX = 'Use the MSR: '
ALERTS_CHANGED = 'The alerts have just changed. Look, and press SEEN again.'
MARK_LOST = '✗'
MARK_YES = '✓'
MARK_WAIT = '…'
SOUND_ON = '♪ SOUND ON'
SOUND_OFF = '✗ SOUND OFF'

LOG = 'Events'
EVERY_KART = 'all karts'
ONE_KART = 'kart {number} {team}'
NEW_RUN = '— race control was started anew —'
DONE = '✓ '
REFUSED = '✗ '

GONE = 'RACE CONTROL IS GONE'
NOT_YET = 'NO RACE CONTROL YET'
USE_MSR = 'USE THE MSR'
GONE_SINCE = 'Last heard {age} ago, in {state}. What is shown below is out of date.'
NOT_YET_DETAIL = 'Looking for {topic} for {age}. ROS domain {domain}.'
GONE_REASON = 'race control is gone'
FAILED = 'RACE CONTROL HAS FAILED'
TWO = 'TWO RACE CONTROLS'
TWO_ADVICE = 'ALL KILL, THEN END ONE'
TWO_DETAIL = 'Two race controls are running in this ROS domain.'
TWO_WHAT_TO_DO = 'Stops go to both. Nothing else can be given.'
TWO_REASON = 'there are two race controls: end one'
STATE_SINCE = 'for {age}'
KILL_HINT = 'SPACE BAR or F12'
KILL_PRESSING = 'PRESSING, {count} times, {age}: no answer'
KILL_NOTE_GONE = 'A stop is pressed again until race control is back.'
STOP_PRESSING = '{command}: pressed {count} times in {age}, {why}. USE THE MSR.'
NO_ANSWER = 'no answer'
KEYS_OFF = 'KEYS OFF: click this window'

GIVEN = '{command} is given.'
READY = 'Ready.  F1 shows the keys.'
PENDING = '{command}: no answer yet, {age}'
PENDING_REASON = 'no answer yet, {age}'
GAVE_UP = '{command}: no answer within {age}. Check the race to see whether it took effect.'
NOT_THERE = '{command} was not given: race control is not there.'
TOO_OLD = '{name}: pressed {age} ago, while the window hung. Nothing was sent: press it again.'
TOO_EARLY = '{name}: pressed before the question was there. Read it and answer now.'
ANSWER_FIRST = 'Answer the question first: Y or N'
CLICK = 'Mouse button'
BARRED = '{command}: {reason}'
WITH_AGE = '{reason}, {age}'
STATED = '{command}: not any more: {reason}'

ASK_TITLE = '{command}?'
ASK_STATE = 'I state: {condition}.'
ASK_YES = 'YES: {condition}   (Y)'
ASK_NO = 'NO   (N or Esc)'
ASK_CHANGED = 'What you are asked to confirm has changed. Press NO and begin again.'
ASK_AGAIN = '{reason}. Press NO and begin again.'

FIELD_KART = 'KART {number}'
FIELD_BEGUN = '{number} …'
FIELD_NO_KART = 'NO KART {number}'
FIELD_EMPTY = 'KART -'
FIELD_TYPE = 'type a number for Ctrl+R, F, G, J'
FIELD_NOT_YET = 'no kart {number} so far'
FIELD_NOT_THERE = 'it is not in the roster'
FIELD_REFUSAL = 'NO KART {number}'
FIELD_REFUSED = 'nothing was sent'
NOT_GIVEN_UNKNOWN = '{command} WAS NOT SENT: there is no kart {number}. Type another number.'
NOT_GIVEN_FORGOTTEN = '{command} WAS NOT SENT: {number} was typed too long ago. Type it again.'
NOT_GIVEN_EMPTY = '{command} WAS NOT SENT: no kart is named. Type its number first.'
ROWS_CHANGED = '{name} WAS NOT SENT: the list of karts has just changed. Look, and press again.'

HELP_TITLE = 'Keys'
HELP_CLOSE = 'CLOSE   (Esc)'
KEY_HELP = (
    ('Space bar, F12', 'ALL KILL, always'),
    ('F2', 'GRID ACTIVE'),
    ('F3', 'GREEN GREEN'),
    ('F4', 'RED FLAG'),
    ('F5', 'RACE OVER'),
    ('F6', 'IN GARAGE'),
    ('F7, F8', 'open, close the track'),
    ('F9', 'the MSR was used'),
    ('F10', 'newest alert seen'),
    ('F11', 'sound on, off'),
    ('A letter', 'FINISH of the kart that shows it'),
    ('A number, arrows', 'name a kart: it stands below ALL KILL'),
    ('Backspace, Esc', 'take back a digit, the number'),
    ('Ctrl+R, Ctrl+F', 'RED RED, RED FLAG to that kart'),
    ('Ctrl+G', 'that kart to the garage'),
    ('Ctrl+J', 'that kart joins or leaves the race'),
    ('Ctrl+L', 'events of that kart only, of all'),
    ('Tab, Enter', 'go to the next button, press it'),
    ('Y, N', 'answer a question'),
)

NO_QT = (
    'rcs_gui: there is no Qt for Python here. Install it: '
    "'apt-get install python3-pyqt6' on Ubuntu 24.04, or 'pip install PySide6-Essentials'."
)
NO_DISPLAY = 'rcs_gui: there is no screen to open a window on (DISPLAY, WAYLAND_DISPLAY).'


def age(seconds: float) -> str:
    """Return a time that has passed, as an official says it."""
    whole = max(0, int(seconds))
    if whole < 100:
        return f'{whole} s'
    if whole < 3600:
        return f'{whole // 60}:{whole % 60:02d} min'
    return f'{whole // 3600}:{whole // 60 % 60:02d} h'


def short_age(seconds: float) -> str:
    """Return a time that matters to a tenth of a second."""
    return f'{max(0.0, seconds):.1f} s' if seconds < 60 else age(seconds)


def kart_name(kart: Kart) -> str:
    """Return how officials call a kart."""
    return f'kart {kart.number} ({kart.team})' if kart.team else f'kart {kart.number}'


def command_name(command: Command, kart: int = 0) -> str:
    """Return what a command is called when it is talked about."""
    return f'{LABELS[command]} kart {kart}' if kart else LABELS[command]


def condition(command: Command, kart: Kart | None, track: Track, statement: str) -> str:
    """
    Return what an official confirms.

    :param statement: what race control asks the official to state; empty if nothing.
    """
    if command is Command.GREEN_GREEN:
        start = 'the race may start, the track is clear of humans'
        return f'{start}, {statement}' if statement else start
    if statement:
        return statement
    if command is Command.RECORD_MSR:
        return 'the Master Safety Remote was used'
    if command is Command.OPEN_TRACK:
        return f'teams are cleared for the track: {track.reason}'
    if command is Command.KART_IN_GARAGE and kart is not None:
        return f'{kart_name(kart)} stands still and may go to its team'
    return f'{LABELS[command]} is meant'


def kart_list(karts: tuple[int, ...]) -> str:
    """Return karts by their numbers."""
    if not karts:
        return 'no kart'
    numbers = ', '.join(map(str, karts))
    return f'kart {numbers}' if len(karts) == 1 else f'{len(karts)} karts: {numbers}'


def consequence(command: Command, karts: tuple[int, ...], kart: Kart | None) -> str:
    """
    Return what a confirmed command does, in a sentence.

    :param karts: the karts that it would start or release, as race control says.
    """
    if kart is not None:
        if kart.hold is State.UNKNOWN:
            return f'Sends IN GARAGE to {kart_name(kart)}.'
        return f'Ends the hold of {kart_name(kart)}: {STATES[kart.hold]}, {kart.hold_reason}.'
    return {
        Command.GRID_ACTIVE: f'Sends GRID ACTIVE to {kart_list(karts)}.',
        Command.GREEN_GREEN: f'Sends GREEN GREEN to {kart_list(karts)}. They drive off.',
        Command.IN_GARAGE: f'Sends IN GARAGE to {kart_list(karts)}. Teams have their karts back.',
        Command.OPEN_TRACK: 'Opens the track to humans.',
        Command.RECORD_MSR: (
            'Records that you used the MSR, and sends RED RED to all karts. '
            'It does not trigger the MSR.'
        ),
    }.get(command, '')
