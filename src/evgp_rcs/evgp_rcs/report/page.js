// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

'use strict';
// Draws the timeline, and shows the events that the reader asks for. Texts of the record are
// only ever drawn, or set as text.
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const element = (id) => document.getElementById(id);
  document.documentElement.classList.add('scripted');
  element('view').hidden = false;
  element('browse').hidden = false;

  // ----- words -------------------------------------------------------------------------------

  const pad = (number, digits) => String(number).padStart(digits, '0');
  const clock = (wall, digits) => {
    const unit = 10 ** (3 - (digits || 0));
    const moment = new Date(Math.floor(Math.round(wall) / unit + 0.5) * unit + data.offset * 1000);
    const text = pad(moment.getUTCHours(), 2) + ':' + pad(moment.getUTCMinutes(), 2) + ':' +
      pad(moment.getUTCSeconds(), 2);
    return digits ? text + '.' + pad(moment.getUTCMilliseconds(), 3).slice(0, digits) : text;
  };
  const timeOfDay = (at, digits) => clock(data.began + at * 1000, digits);
  const elapsed = (at) => {
    const ms = Math.round(at * 1000), hours = Math.floor(ms / 3600000);
    const minutes = Math.floor(ms / 60000) % 60, rest = pad((ms % 60000 / 1000).toFixed(3), 6);
    return '+' + (hours ? hours + ':' + pad(minutes, 2) : minutes) + ':' + rest;
  };
  const duration = (seconds) => {
    // It stands beside times of day with as many digits.
    const text = elapsed(seconds).slice(1).replace(/^0:0?/, '');
    return text + [' s', ' min', ' h'][text.split(':').length - 1];
  };
  const kindOf = (kind) => data.kinds[kind] || kind;
  const cut = (text, most) => text.length > most ? text.slice(0, most) + '…' : text;

  const bySequence = new Map(data.events.map((event) => [event[0], event]));

  // ----- the timeline ------------------------------------------------------------------------

  const COLOURS = {
    IN_GARAGE: ['#e2e6ea', '#000'], GRID_ACTIVE: ['#f2c200', '#000'],
    GREEN_GREEN: ['#0a7d3e', '#fff'], RED_FLAG: ['#f08a00', '#000'],
    RED_RED: ['#b3001b', '#fff'], NOT_CONNECTED: ['#fff', '#000'], NOT_KNOWN: ['#fff', '#000'],
  };
  // What is shown where there is no room for all: what matters most to a jury.
  const WORST = ['IN_GARAGE', 'GRID_ACTIVE', 'GREEN_GREEN', 'NOT_CONNECTED', 'RED_FLAG',
    'RED_RED', 'NOT_KNOWN'];
  const MARKS = {ACKNOWLEDGED: '✓', DISCONNECTED: '✗', WITHDRAWN: '↺'};
  const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200,
    14400, 43200];
  const FONT = 'system-ui, "DejaVu Sans", Arial, sans-serif';
  const LEFT = 92, AXIS = 26, COMMANDS = 5, COMMAND_ROW = 17, ALERTS = 3, ALERT_ROW = 17, ROW = 34;
  const APART = 13;  // what is nearer to the next one is drawn without its sign
  const SHORTEST = 0.2, OVERVIEW = 16;
  const PAPER = 1400, SHEET = 20;  // width of a sheet, and the most karts on it

  const canvas = element('lines'), tip = element('tip'), detail = element('detail');
  let pen = canvas.getContext('2d');
  const first = data.start, last = Math.max(data.end, data.start + SHORTEST);
  let from = first, to = last, width = 0, chosen = null, cursor = null;

  let lines = [], bottom = 0, unseenAlerts = 0;
  const arrange = (lanes) => {
    lines = [
      {name: 'Commands', kind: 'commands', height: COMMANDS * COMMAND_ROW + 6},
      {name: 'Alerts', kind: 'alerts', height: ALERTS * ALERT_ROW + 6},
      {name: 'Race', kind: 'lane', height: ROW, lane: {bands: data.race, holds: [], marks: []}},
      ...lanes.map((lane) => (
        {name: 'Kart ' + lane.kart, kind: 'lane', height: ROW, lane, kart: lane.kart, team: lane.team})),
    ];
    bottom = AXIS;
    for (const line of lines) { line.top = bottom; bottom += line.height; }
  };
  arrange(data.lanes);
  const height = bottom + OVERVIEW + 6;
  let drawn = [];  // the commands and alerts where they were drawn: [left, top, right, bottom, thing]

  const x = (at) => LEFT + (at - from) / (to - from) * (width - LEFT);
  const when = (px) => from + (px - LEFT) / (width - LEFT) * (to - from);

  /** Return the index of the first of `sorted` that is not before `at`. */
  const search = (sorted, at, key) => {
    let low = 0, high = sorted.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (key(sorted[middle]) < at) low = middle + 1; else high = middle;
    }
    return low;
  };

  let asked = false;
  const draw = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => { asked = false; paint(); });
  };

  const paint = () => {
    const scale = window.devicePixelRatio || 1;
    width = canvas.parentElement.clientWidth;
    if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
      canvas.width = Math.round(width * scale);
      canvas.height = Math.round(height * scale);
      canvas.style.height = height + 'px';
    }
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    paintLines();
    paintOverview();
    canvas.dataset.from = from;
    canvas.dataset.to = to;
  };

  const paintLines = () => {
    pen.fillStyle = '#fff';
    pen.fillRect(0, 0, width, height);
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, 0, width - LEFT, height);
    pen.clip();
    paintAxis();
    drawn = [];
    for (const line of lines) {
      if (line.kind === 'commands') paintCommands(line);
      else if (line.kind === 'alerts') paintAlerts(line);
      else paintLane(line);
    }
    if (cursor !== null) {
      pen.fillStyle = '#1f6feb';
      pen.fillRect(x(cursor) - 0.5, AXIS, 1, bottom - AXIS);
    }
    pen.restore();
    paintNames();
  };

  /** Return a part of the timeline for paper, which cannot be zoomed. */
  const picture = (name, start, end, lanes) => {
    const figure = document.createElement('figure'), paper = document.createElement('canvas');
    const seen = [pen, width, from, to, chosen, cursor];
    [pen, width, from, to, chosen, cursor] = [paper.getContext('2d'), PAPER, start, end, null, null];
    arrange(lanes);
    paper.width = width * 2;
    paper.height = bottom * 2;
    pen.scale(2, 2);
    paintLines();
    [pen, width, from, to, chosen, cursor] = seen;
    arrange(data.lanes);
    figure.append(Object.assign(document.createElement('h3'), {textContent: name}), paper);
    return figure;
  };
  window.addEventListener('beforeprint', () => {
    // Where a race is most of what there is, it is seen well enough.
    const parts = [['', first, last], ...data.races.map(([start, end, number]) => {
      const margin = (end - start) * 0.03;
      return ['Race ' + number, Math.max(first, start - margin), Math.min(last, end + margin)];
    }).filter(([, start, end]) => end > start && end - start < 0.6 * (last - first))];
    const pictures = parts.flatMap(([name, start, end]) =>
      Array.from({length: Math.ceil(data.lanes.length / SHEET) || 1}, (_, n) =>
        picture(name, start, end, data.lanes.slice(n * SHEET, (n + 1) * SHEET))));
    element('pictures').replaceChildren(...pictures);
    draw();
  });

  const paintAxis = () => {
    const step = STEPS.find((each) => (to - from) / each <= (width - LEFT) / 90) || 86400;
    // Full seconds and minutes of the wall clock, which is what people noted.
    const offset = data.began / 1000 + data.offset;
    pen.font = '12px ' + FONT;
    pen.textAlign = 'center';
    for (let n = Math.ceil((from + offset) / step); n * step - offset <= to; n++) {
      const px = x(n * step - offset);
      pen.fillStyle = '#ccc';
      pen.fillRect(px - 0.5, AXIS - 4, 1, bottom - AXIS + 4);
      pen.fillStyle = '#000';
      if (px > LEFT + 30) pen.fillText(timeOfDay(n * step - offset, step < 1 ? 1 : 0), px, 16);
    }
    for (const [start, end] of data.gaps) {
      if (end < from || start > to) continue;
      pen.fillStyle = '#ffe08a';
      pen.fillRect(x(start), AXIS, Math.max(3, x(end) - x(start)), bottom - AXIS);
    }
    pen.textAlign = 'left';
  };

  const paintCommands = (line) => {
    pen.font = 'bold 12px ' + FONT;
    // What began a little further left may still reach in.
    const margin = 300 / (width - LEFT) * (to - from), commands = data.commands, seen = [];
    let before = -Infinity;
    for (let n = search(commands, from - margin, (each) => each[0]); n < commands.length; n++) {
      const command = commands[n];
      if (command[0] > to) break;
      seen.push(command);
      const px = x(command[0]);
      if (px - before >= 1) {
        before = px;
        pen.fillStyle = command[2] ? '#000' : '#b3001b';
        pen.fillRect(px - 0.5, line.top + line.height - 7, 1, 7);
      }
    }
    // Those to the whole race find room first.
    const rows = Array.from({length: COMMANDS}, () => []), labels = [];
    const place = (command) => {
      const [at, name, accepted, official] = command, px = x(at);
      const text = (accepted ? '' : '✗ ') + name + (official ? ' · ' + cut(official, 24) : '');
      const wide = pen.measureText(text).width + 8;
      // At the right edge it stands left of its moment, so that none of it is cut off.
      const left = px > width ? px : Math.max(Math.min(px, width - wide - 1), Math.min(px, LEFT));
      const row = rows.findIndex((row) => row.every(([a, b]) => left + wide + 3 < a || left > b));
      if (row < 0) return;
      rows[row].push([left, left + wide + 3]);
      labels.push([command, text, px, left, wide, line.top + 2 + row * COMMAND_ROW]);
    };
    for (const first of [true, false]) {
      for (const command of seen) if ((command[5] === 1) === first) place(command);
    }
    for (const [command, , px, , , top] of labels) {
      pen.fillStyle = command[2] ? '#000' : '#b3001b';
      pen.fillRect(px - 0.5, top, 1, line.top + line.height - top);
    }
    for (const [command, text, , left, wide, top] of labels) {
      const accepted = command[2];
      pen.fillStyle = command === chosen ? '#dce8ff' : '#fff';
      pen.fillRect(left, top, wide, COMMAND_ROW - 2);
      pen.lineWidth = command === chosen ? 2 : 1;
      pen.strokeStyle = pen.fillStyle = accepted ? '#000' : '#b3001b';
      pen.setLineDash(accepted ? [] : [3, 2]);
      pen.strokeRect(left + 0.5, top + 0.5, wide - 1, COMMAND_ROW - 3);
      pen.setLineDash([]);
      pen.fillText(text, left + 4, top + 12);
      drawn.push([left - 2, top, left + wide, top + COMMAND_ROW, {kind: 'command', item: command}]);
    }
  };

  const paintAlerts = (line) => {
    const free = new Array(ALERTS).fill(-Infinity);
    let left = 0;
    pen.font = 'bold 12px ' + FONT;
    for (const alert of data.alerts) {
      const [start, end, kart, sequence] = alert;
      if (end < from || start > to) continue;
      const a = Math.max(x(start), LEFT), b = Math.min(Math.max(x(end), a + 3), width);
      const row = free.findIndex((until) => until < a);
      if (row < 0) { left++; continue; }
      free[row] = b + 1;
      const top = line.top + 2 + row * ALERT_ROW;
      pen.fillStyle = alert === chosen ? '#dce8ff' : '#ffe08a';
      pen.fillRect(a, top, b - a, ALERT_ROW - 2);
      pen.strokeStyle = '#000';
      pen.lineWidth = 1;
      pen.strokeRect(a + 0.5, top + 0.5, Math.max(1, b - a - 1), ALERT_ROW - 3);
      const event = bySequence.get(sequence);
      const whole = '! ' + (event ? event[6] : '');
      const short = pen.measureText(whole).width > b - a && kart;
      clipped(short ? '! kart ' + kart : whole, a + 3, top + 12, b - a - 5, '#000');
      drawn.push([a - 1, top, b + 1, top + ALERT_ROW, {kind: 'alert', item: alert}]);
    }
    unseenAlerts = left;
  };

  const clipped = (text, left, base, room, colour) => {
    if (room < 12) return;
    pen.save();
    pen.beginPath();
    pen.rect(left, base - 14, room, 20);
    pen.clip();
    pen.fillStyle = colour;
    pen.fillText(cut(text, 200), left, base);
    pen.restore();
  };

  const paintLane = (line) => {
    const {bands, holds, marks} = line.lane, top = line.top + 3, tall = line.height - 6;
    pen.font = 'bold 12px ' + FONT;
    let tiny = null;
    const flush = () => {
      if (tiny) paintBand(tiny[0], tiny[1], tiny[2], top, tall);
      tiny = null;
    };
    for (let n = Math.max(0, search(bands, from, (each) => each[1])); n < bands.length; n++) {
      const [start, end, what] = bands[n];
      if (start > to) break;
      const a = x(Math.max(start, from)), b = x(Math.min(end, to));
      if (tiny && b - tiny[0] < 1) {
        if (WORST.indexOf(what) > WORST.indexOf(tiny[2])) tiny[2] = what;
        tiny[1] = b;
        continue;
      }
      flush();
      if (b - a < 1) { tiny = [a, b, what]; continue; }
      paintBand(a, b, what, top, tall);
    }
    flush();
    for (let n = search(holds, from, (each) => each[1]); n < holds.length; n++) {
      const [start, end] = holds[n];
      if (start > to) break;
      const a = x(Math.max(start, from)), wide = Math.max(1, x(Math.min(end, to)) - a);
      pen.fillStyle = '#fff';
      pen.fillRect(a, top + 4, wide, 1);
      pen.fillStyle = '#000';
      pen.fillRect(a, top, wide, 4);
      // The word stands where it covers no other: in the widest of the bands.
      let best = [0, 0];
      for (let m = search(bands, start, (each) => each[1]); m < bands.length; m++) {
        if (bands[m][0] >= end || bands[m][0] > to) break;
        const b = x(Math.min(bands[m][1], end, to));
        const room = b - x(Math.max(bands[m][0], start, from));
        if (room > best[0]) best = [room, b];
      }
      if (best[0] > 150) {
        pen.font = 'bold 10px ' + FONT;
        const room = pen.measureText('HELD').width + 6;
        pen.fillRect(best[1] - room, top, room, 13);
        pen.fillStyle = '#fff';
        pen.fillText('HELD', best[1] - room + 3, top + 10);
      }
    }
    pen.textAlign = 'center';
    pen.font = 'bold 10px ' + FONT;
    const low = top + tall - 7;
    let before = -Infinity;
    for (let n = search(marks, from - (to - from) / 100, (each) => each[0]); n < marks.length; n++) {
      const [at, kind] = marks[n], px = x(at);
      if (px > width + APART) break;
      const next = n + 1 < marks.length ? x(marks[n + 1][0]) : Infinity;
      const alone = px - before >= APART && next - px >= APART;
      if (!alone && px - before < 1 && kind === 'ACKNOWLEDGED' && marks[n] !== chosen) continue;
      before = px;
      if (MARKS[kind] && (alone || kind === 'DISCONNECTED' || marks[n] === chosen)) {
        pen.fillStyle = '#fff';
        pen.beginPath();
        pen.arc(px, low, 6.5, 0, 7);
        pen.fill();
        pen.lineWidth = marks[n] === chosen ? 3 : 1;
        pen.strokeStyle = marks[n] === chosen ? '#1f6feb' : '#000';
        pen.stroke();
        pen.fillStyle = kind === 'ACKNOWLEDGED' ? '#000' : '#b3001b';
        pen.fillText(MARKS[kind], px, low + 4);
      } else {
        pen.fillStyle = '#fff';
        pen.fillRect(px - 1.5, low - 3, 3, 10);
        pen.fillStyle = marks[n] === chosen ? '#1f6feb' : MARKS[kind] ? '#000' : '#777';
        pen.fillRect(px - 0.5, low - 2, 1, 8);
      }
    }
    pen.textAlign = 'left';
  };

  const paintBand = (a, b, what, top, tall) => {
    const [back, fore] = COLOURS[what] || COLOURS.NOT_KNOWN;
    const wide = Math.max(1, b - a);
    pen.fillStyle = back;
    pen.fillRect(a, top, wide, tall);
    if (wide < 2) return;
    if (what === 'NOT_CONNECTED' || what === 'NOT_KNOWN') {
      pen.strokeStyle = '#888';
      pen.lineWidth = 1;
      pen.setLineDash(what === 'NOT_KNOWN' ? [1, 3] : [5, 3]);
      pen.strokeRect(a + 0.5, top + 0.5, wide - 1, tall - 1);
      pen.setLineDash([]);
    } else {
      pen.fillStyle = '#000';
      pen.fillRect(a, top, 1, tall);
    }
    const word = data.states[what], short = data.short[what];
    const text = pen.measureText(word).width + 12 <= wide ? word :
      pen.measureText(short).width + 8 <= wide ? short : '';
    pen.fillStyle = fore;
    if (text) pen.fillText(text, a + 5, top + 14);
  };

  const paintNames = () => {
    pen.fillStyle = '#fff';
    pen.fillRect(0, 0, LEFT, height);
    pen.font = 'bold 13px ' + FONT;
    pen.textAlign = 'right';
    for (const line of lines) {
      pen.fillStyle = '#000';
      pen.fillText(line.name, LEFT - 8, line.top + (line.kind !== 'lane' || line.team ? 15 : 20));
      if (line.team) {
        pen.font = '10px ' + FONT;
        let most = line.team.length;
        while (pen.measureText(cut(line.team, most)).width > LEFT - 12) most--;
        pen.fillText(cut(line.team, most), LEFT - 8, line.top + 28);
        pen.font = 'bold 13px ' + FONT;
      }
      pen.fillStyle = '#ddd';
      pen.fillRect(0, line.top + line.height - 1, width, 1);
    }
    if (unseenAlerts) {
      pen.font = '12px ' + FONT;
      pen.fillStyle = '#b3001b';
      pen.fillText(unseenAlerts + ' more:', LEFT - 8, lines[1].top + 31);
      pen.fillText('see Alerts', LEFT - 8, lines[1].top + 46);
    }
    pen.textAlign = 'left';
    pen.fillStyle = '#000';
    pen.fillRect(LEFT - 1, 0, 1, bottom);
  };

  /** Show at the bottom which part of the whole is seen. */
  const paintOverview = () => {
    const top = bottom + 4, room = width - LEFT, all = last - first;
    for (const [start, end, what] of data.race) {
      pen.fillStyle = (COLOURS[what] || COLOURS.NOT_KNOWN)[0];
      pen.fillRect(LEFT + (start - first) / all * room, top, Math.max(1, (end - start) / all * room),
        OVERVIEW - 4);
    }
    pen.strokeStyle = '#000';
    pen.lineWidth = 3;
    pen.strokeRect(LEFT + (from - first) / all * room + 1.5, top - 1.5,
      Math.max(4, (to - from) / all * room - 3), OVERVIEW - 1);
    pen.fillStyle = '#000';
    pen.font = '12px ' + FONT;
    pen.textAlign = 'right';
    pen.fillText(data.isWhole ? 'whole run' : 'whole part', LEFT - 8, top + 10);
    pen.textAlign = 'left';
  };

  const show = (a, b) => {
    const span = Math.min(last - first, Math.max(SHORTEST, b - a));
    const middle = (a + b) / 2;
    from = Math.min(Math.max(first, middle - span / 2), last - span);
    to = from + span;
    draw();
  };
  const zoom = (factor, about) => {
    const span = Math.min(last - first, Math.max(SHORTEST, (to - from) * factor));
    const share = (about - from) / (to - from), start = about - share * span;
    from = Math.min(Math.max(first, start), last - span);
    to = from + span;
    draw();
  };
  const move = (by) => show(from + by, to + by);

  // ----- what is under the pointer -----------------------------------------------------------

  const lineAt = (y) => lines.find((line) => y >= line.top && y < line.top + line.height);

  const find = (px, py) => {
    if (px < LEFT) return null;
    for (let n = drawn.length - 1; n >= 0; n--) {
      const [a, t, b, u, thing] = drawn[n];
      if (px >= a && px <= b && py >= t && py <= u) return thing;
    }
    const line = lineAt(py);
    if (!line || line.kind !== 'lane') return null;
    const at = when(px), near = 7 / (width - LEFT) * (to - from);
    const marks = line.lane.marks;
    let best = null;
    for (let n = search(marks, at - near, (each) => each[0]); n < marks.length; n++) {
      if (marks[n][0] > at + near) break;
      if (!best || Math.abs(marks[n][0] - at) < Math.abs(best[0] - at)) best = marks[n];
    }
    if (best && py > line.top + 16) return {kind: 'mark', item: best, line};
    const n = search(line.lane.bands, at, (each) => each[1]);
    const band = line.lane.bands[n];
    return band && band[0] <= at ? {kind: 'band', item: band, line, at} : null;
  };

  const describe = (thing) => {
    const {kind, item, line} = thing;
    const who = line && line.name + (line.team ? ' (' + line.team + ')' : '');
    if (kind === 'command') {
      const event = bySequence.get(item[4]);
      return item[1] + (item[2] ? '' : ', refused') + '\n' + timeOfDay(item[0], 3) + ' (' +
        elapsed(item[0]) + '), from ' + (item[3] || 'an unnamed official') + '\n' +
        (event ? event[6] : '');
    }
    if (kind === 'alert') {
      const event = bySequence.get(item[3]);
      return 'Alert\n' + (event ? timeOfDay(item[0], 3) + ': ' + event[6] + '\n' : '') +
        'How long it stood: ' + item[4];
    }
    if (kind === 'mark') {
      const event = bySequence.get(item[2]);
      return who + ': ' + kindOf(item[1]) + '\n' + timeOfDay(item[0], 3) + ' (' +
        elapsed(item[0]) + ')\n' + (event ? event[6] : '');
    }
    const [start, end, what, acknowledged] = item, word = data.states[what];
    let text = who;
    if (what === 'NOT_CONNECTED') text += ' is not connected';
    else if (what === 'NOT_KNOWN') text += ': the record does not say what it is';
    else text += (line.kart ? ' is sent ' : ' is in ') + word;
    text += '\nfrom ' + timeOfDay(start, 3) + ' to ' + timeOfDay(end, 3) + ', ' +
      duration(end - start);
    if (line.kart && !['NOT_CONNECTED', 'NOT_KNOWN'].includes(what)) {
      text += acknowledged === null ? '\nnot acknowledged in this time' :
        '\nacknowledged at ' + timeOfDay(acknowledged, 3) + ', after ' +
        duration(acknowledged - start);
    }
    for (const [begins, ends, command] of line.lane.holds) {
      if (begins <= thing.at && thing.at <= ends) {
        text += '\nheld from ' + timeOfDay(begins, 3) + ' to ' + timeOfDay(ends, 3) +
          (command ? ', since ' + command : '');
      }
    }
    return text;
  };

  const point = (px, py) => {
    const thing = find(px, py);
    cursor = px >= LEFT ? when(px) : null;
    chosen = thing ? thing.item : null;
    draw();
    if (!thing) { tip.hidden = true; return; }
    const text = describe(thing);
    tip.textContent = cut(text, 700);
    tip.hidden = false;
    const room = canvas.clientWidth;
    tip.style.left = Math.max(0, Math.min(px + 14, room - tip.offsetWidth - 4)) + 'px';
    const below = py + 18;
    tip.style.top = (below + tip.offsetHeight > height ? Math.max(0, py - tip.offsetHeight - 12) :
      below) + 'px';
    detail.textContent = text;
  };

  let grabbed = null;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener('pointerdown', (event) => {
    canvas.focus({preventScroll: true});
    const [px, py] = place(event);
    if (py > bottom) {
      const at = first + (px - LEFT) / (width - LEFT) * (last - first);
      show(at - (to - from) / 2, at + (to - from) / 2);
      return;
    }
    grabbed = [px, from, to];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener('pointermove', (event) => {
    const [px, py] = place(event);
    if (grabbed) {
      const by = (grabbed[0] - px) / (width - LEFT) * (grabbed[2] - grabbed[1]);
      show(grabbed[1] + by, grabbed[2] + by);
    }
    point(px, py);
  });
  canvas.addEventListener('pointerup', () => { grabbed = null; });
  canvas.addEventListener('pointercancel', () => { grabbed = null; });
  canvas.addEventListener('pointerleave', () => { tip.hidden = true; cursor = null; draw(); });
  canvas.addEventListener('wheel', (event) => {
    if (!event.ctrlKey && document.activeElement !== canvas) return;
    event.preventDefault();
    const [px] = place(event);
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      move((event.deltaX || event.deltaY) / (width - LEFT) * (to - from));
    } else {
      zoom(Math.exp(Math.max(-200, Math.min(200, event.deltaY)) / 400), when(Math.max(px, LEFT)));
    }
  }, {passive: false});

  // ----- by key ------------------------------------------------------------------------------

  let lineNow = 0, itemNow = -1;
  const itemsOf = (line) => {
    if (line.kind === 'commands') return data.commands.map((item) => ({kind: 'command', item, at: item[0]}));
    if (line.kind === 'alerts') return data.alerts.map((item) => ({kind: 'alert', item, at: item[0]}));
    return [
      ...line.lane.bands.map((item) => ({kind: 'band', item, line, at: item[0]})),
      ...line.lane.marks.map((item) => ({kind: 'mark', item, line, at: item[0]})),
    ].sort((a, b) => a.at - b.at);
  };
  const choose = () => {
    const line = lines[lineNow], items = itemsOf(line);
    tip.hidden = true;
    if (!items.length) { detail.textContent = line.name + ': nothing'; return; }
    itemNow = Math.min(Math.max(itemNow, 0), items.length - 1);
    const thing = items[itemNow];
    chosen = thing.item;
    cursor = thing.at;
    if (thing.at < from || thing.at > to) {
      show(thing.at - (to - from) / 2, thing.at + (to - from) / 2);
    }
    detail.textContent = describe(thing);
    draw();
  };
  canvas.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const middle = cursor === null ? (from + to) / 2 : Math.min(Math.max(cursor, from), to);
    const change = (step) => {
      lineNow = Math.min(Math.max(lineNow + step, 0), lines.length - 1);
      itemNow = cursor === null ? 0 :
        Math.max(0, itemsOf(lines[lineNow]).findLastIndex((each) => each.at <= cursor));
      choose();
    };
    const keys = {
      '+': () => zoom(0.5, middle), '=': () => zoom(0.5, middle), '-': () => zoom(2, middle),
      Home: () => show(first, last),
      ArrowLeft: () => { itemNow--; choose(); }, ArrowRight: () => { itemNow++; choose(); },
      ArrowUp: () => change(-1), ArrowDown: () => change(1),
      PageUp: () => move(from - to), PageDown: () => move(to - from),
    };
    if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
  });

  const doings = {
    in: () => zoom(0.5, (from + to) / 2), out: () => zoom(2, (from + to) / 2),
    left: () => move((from - to) / 2), right: () => move((to - from) / 2),
    whole: () => show(first, last),
    race: (button) => {
      const [start, end] = data.races[Number(button.dataset.race)];
      show(start - (end - start) * 0.03, end + (end - start) * 0.03);
    },
  };
  for (const button of document.querySelectorAll('button[data-do]')) {
    button.addEventListener('click', () => doings[button.dataset.do](button));
  }
  new ResizeObserver(draw).observe(canvas.parentElement);
  paint();

  // ----- the table ---------------------------------------------------------------------------

  const HIGH = 30, BEYOND = 10;
  const box = element('scroll'), rows = element('rows'), found = element('found');
  const kart = element('kart'), kind = element('kind'), words = element('find');
  let matching = data.events, opened = null, painted = '';

  const labels = new Map(data.commands.map((command) => [command[4], command[1]]));
  const sentenceOf = (event) => (labels.has(event[0]) ? labels.get(event[0]) + ': ' : '') +
    event[6] + (event[7] ? ' [' + event[7] + ']' : '');
  const fits = (event, number, sort, text) => {
    if (number && event[3] !== number) return false;
    if (sort === '!' ? data.lesser.includes(event[4]) : sort === 'refused' ?
      event[4] !== 'COMMAND' || event[5] : sort && event[4] !== sort) return false;
    return !text || sentenceOf(event).toLowerCase().includes(text);
  };
  const filter = () => {
    const number = Number(kart.value), text = words.value.trim().toLowerCase();
    matching = data.events.filter((event) => fits(event, number, kind.value, text));
    const all = data.events.length.toLocaleString('en');
    found.textContent = matching.length === data.events.length ? all + ' events' :
      matching.length.toLocaleString('en') + ' of ' + all + ' events';
    opened = null;
    box.scrollTop = 0;
    fill(true);
  };
  const row = (event) => {
    const line = document.createElement('tr');
    const cells = [event[0], clock(event[1], 3), elapsed(event[2]), event[3] || '',
      kindOf(event[4]) + (event[5] ? '' : ' ✗'),
      sentenceOf(event)];
    for (const text of cells) line.insertCell().textContent = text;
    line.lastChild.title = cut(cells[5], 700);
    if (!event[5]) line.classList.add('refused');
    if (event[0] === opened) line.classList.add('chosen');
    line.dataset.sequence = event[0];
    return line;
  };
  const space = (tall) => {
    const line = document.createElement('tr'), cell = line.insertCell();
    cell.colSpan = 6;
    cell.style.cssText = 'padding:0;border:0;height:' + tall + 'px';
    return line;
  };
  /** Have the rows in the document that are seen; of tens of thousands, no others. */
  const fill = (anyway) => {
    const start = Math.max(0, Math.floor(box.scrollTop / HIGH) - BEYOND);
    const end = Math.min(matching.length, start + Math.ceil(box.clientHeight / HIGH) + 2 * BEYOND);
    const now = start + '-' + end + '-' + opened;
    if (!anyway && now === painted) return;
    painted = now;
    rows.replaceChildren(space(start * HIGH), ...matching.slice(start, end).map(row),
      space((matching.length - end) * HIGH));
  };
  box.addEventListener('scroll', () => fill(false));
  rows.addEventListener('click', (event) => {
    const line = event.target.closest('tr[data-sequence]');
    if (!line) return;
    const sequence = Number(line.dataset.sequence);
    opened = opened === sequence ? null : sequence;
    fill(true);
    const at = bySequence.get(sequence)[2];
    cursor = at;
    if (at < from || at > to) show(at - (to - from) / 2, at + (to - from) / 2);
    draw();
  });
  for (const each of [kart, kind]) each.addEventListener('change', filter);
  words.addEventListener('input', filter);
  new ResizeObserver(() => fill(false)).observe(box);
  filter();
})();
