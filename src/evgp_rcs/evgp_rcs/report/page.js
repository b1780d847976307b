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

  const UNMARKED = ['COMMAND', 'KART_STATE', 'LINK_GRADE', 'ALERT_RAISED', 'ALERT_CLEARED'];
  const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200,
    14400, 43200];
  const ALERT_ROWS = 3, SHEET = 20;  // most karts on a sheet of paper
  const SHORTEST = 0.2, WIDEST = 1e7;  // s, px: browsers place nothing further right

  const make = (parent, kind, text) => {
    const made = document.createElement('div');
    made.className = kind;
    made.textContent = text || '';
    parent.append(made);
    return made;
  };
  const sentence = (sequence) => bySequence.has(sequence) ? bySequence.get(sequence)[6] : '';
  const moment = (at) => timeOfDay(at, 3) + ' (' + elapsed(at) + ')';

  const ofBand = (lane, name) => ([start, end, what, acknowledged, delivered]) => {
    const sent = !['NOT_CONNECTED', 'NOT_KNOWN'].includes(what);
    const is = what === 'NOT_CONNECTED' ? ' is not connected' :
      what === 'NOT_KNOWN' ? ': the record does not say what it is' :
        (lane.kart ? ' is sent ' : ' is in ') + data.states[what];
    const held = lane.holds.filter(([begins, ends]) => begins < end && ends > start);
    return name + is + '\nfrom ' + timeOfDay(start, 3) + ' to ' + timeOfDay(end, 3) + ', ' +
      duration(end - start) +
      (delivered === null ? '' : '\ndelivered after ' + duration(delivered - start)) +
      (!sent || !lane.kart ? '' : acknowledged === null ?
        '\nnot acknowledged in this time' : '\nacknowledged at ' + timeOfDay(acknowledged, 3) +
        ', after ' + duration(acknowledged - start)) +
      held.map(([begins, ends, command]) => '\nheld from ' + timeOfDay(begins, 3) + ' to ' +
        timeOfDay(ends, 3) + (command ? ', since ' + command : '')).join('');
  };

  /** Return the element with the lines from `start` to `end`, their items, and how to scale it. */
  const timeline = (start, end, lanes, onPaper) => {
    const whole = document.createElement('div'), lines = [];
    whole.className = 'lines';
    const share = (at) => (Math.min(Math.max(at, start), end) - start) / (end - start) * 100;
    let line;
    const begin = (kind, name, team) => {
      const row = make(whole, 'line ' + kind);
      const heading = make(row, 'name', name);
      if (team) make(heading, 'team', team);
      line = {name, track: make(row, 'track'), items: []};
      lines.push(line);
    };
    const put = (kind, text, from, to, row, describe) => {
      if (to < start || from > end) return;
      const item = make(line.track, kind);
      item.style.left = share(from) + '%';
      item.style.width = share(to) - share(from) + '%';
      item.style.setProperty('--row', row);
      if (kind.startsWith('command') && share(from) > 90) {  // so that none of it is cut off
        Object.assign(item.style, {left: 'auto', right: 100 - share(from) + '%', width: 'auto'});
      }
      if (text) make(item, 'word', text);
      if (!describe) return;
      Object.assign(item, {at: from, describe});
      item.classList.add('item');
      line.items.push(item);
    };
    const axis = make(make(whole, 'line axis'), 'name').parentElement;
    const ticks = make(axis, 'track');

    // A command has its row up to the next one in it: those to the whole race have rows of their own.
    begin('commands', 'Commands');
    for (const [toAll, rows, top] of [[true, 2, 0], [false, 3, 2]]) {
      const commands = data.events.filter((each) => each[8] && !each[3] === toAll);
      commands.forEach(([, , at, , , accepted, sentence, official, name], n) => {
        const next = commands[n + rows];
        const text = (accepted ? '' : '✗ ') + name + (official ? ' · ' + cut(official, 24) : '');
        put(accepted ? 'command' : 'command refused', text, at, next ? next[2] : end, top + n % rows,
          () => name + (accepted ? '' : ', refused') + '\n' + moment(at) + ', from ' +
            (official || 'an unnamed official') + '\n' + sentence);
      });
    }
    line.items.sort((a, b) => a.at - b.at);

    begin('alerts', 'Alerts');
    const free = new Array(ALERT_ROWS).fill(-Infinity);
    let unseen = 0;
    for (const [from, to, , sequence, stood] of data.alerts) {
      const row = free.findIndex((until) => until <= from);
      if (row < 0) { unseen++; continue; }
      free[row] = to;
      put('alert', '! ' + cut(sentence(sequence), 200), from, to, row, () => 'Alert\n' +
        timeOfDay(from, 3) + ': ' + sentence(sequence) + '\nHow long it stood: ' + stood);
    }
    if (unseen) make(line.track.previousSibling, 'more', unseen + ' more: see Alerts');

    for (const lane of [{bands: data.race, holds: [], links: []}, ...lanes]) {
      const kart = lane.kart ? 'Kart ' + lane.kart : 'Race';
      const name = kart + (lane.team ? ' (' + lane.team + ')' : '');
      begin('lane', kart, lane.team);
      const describe = ofBand(lane, name);
      for (const band of lane.bands) {
        put('band ' + band[2], data.states[band[2]], band[0], band[1], 0, () => describe(band));
      }
      for (const [from, to] of lane.holds) put('hold', '', from, to, 0);
      for (const [from, to, grade] of lane.links) {
        if (grade === 'UNKNOWN') continue;
        put('grade ' + grade, '', from, to, 0, () => name + ': its link is ' + grade.toLowerCase() +
          '\nfrom ' + timeOfDay(from, 3) + ' to ' + timeOfDay(to, 3) + ', ' + duration(to - from));
      }
      const marks = data.events.filter((each) => each[3] === lane.kart && !UNMARKED.includes(each[4]));
      marks.forEach(([, , at, , kind, , sentence], n) => {
        const next = n + 1 < marks.length ? marks[n + 1][2] : end;
        // Paper cannot be zoomed: marks that would cover each other are left out there.
        if (onPaper && kind !== 'DISCONNECTED' && share(next) - share(at) < 0.5) return;
        put('mark ' + kind, '', at, next, 0, () =>
          name + ': ' + kindOf(kind) + '\n' + moment(at) + '\n' + sentence);
      });
      line.items.sort((a, b) => a.at - b.at);
    }

    /** Put times at the top, so that they stand apart where `from` to `to` is so many pixels wide. */
    const scale = (from, to, wide) => {
      const step = STEPS.find((each) => (to - from) / each <= wide / 90) || 86400;
      // Full seconds and minutes of the wall clock, which is what people noted.
      const offset = data.began / 1000 + data.offset;
      ticks.replaceChildren();
      for (const [a, b] of data.gaps) {
        const gap = make(ticks, 'gap');
        gap.style.left = share(a) + '%';
        gap.style.width = share(b) - share(a) + '%';
      }
      for (let n = Math.ceil((from + offset) / step); n * step - offset <= to; n++) {
        make(ticks, 'tick', timeOfDay(n * step - offset, step < 1 ? 1 : 0)).style.left =
          share(n * step - offset) + '%';
      }
    };
    return {whole, lines, scale, share};
  };

  const plot = element('plot'), tip = element('tip'), detail = element('detail');
  const first = data.start, last = Math.max(data.end, data.start + SHORTEST);
  const {whole, lines, scale, share} = timeline(first, last, data.lanes);
  const cursor = make(whole, 'line cursor');
  const stroke = make(make(cursor, 'name').parentElement, 'track');
  const room = () => plot.clientWidth - whole.querySelector('.name').offsetWidth;
  plot.append(whole);

  let times = 1, from = first, to = last;
  const look = () => {
    from = first + plot.scrollLeft / (room() * times) * (last - first);
    to = from + (last - first) / times;
    scale(from, to, room());
    Object.assign(plot.dataset, {from, to});
  };
  const show = (a, b) => {
    const all = last - first, span = Math.min(all, Math.max(SHORTEST, all * room() / WIDEST, b - a));
    const start = Math.min(Math.max(first, (a + b - span) / 2), last - span);
    times = all / span;
    whole.style.setProperty('--times', times);
    plot.scrollLeft = (start - first) / all * room() * times;
    look();
  };
  const zoom = (factor, about) => show(about + (from - about) * factor, about + (to - about) * factor);
  const move = (by) => show(from + by, to + by);
  const bring = (at) => {
    make(stroke, 'stroke').style.left = share(at) + '%';
    while (stroke.children.length > 1) stroke.firstChild.remove();
    if (at < from || at > to) show(at - (to - from) / 2, at + (to - from) / 2);
  };
  plot.addEventListener('scroll', look);
  new ResizeObserver(() => show(from, to)).observe(plot);

  window.addEventListener('beforeprint', () => {
    // Where a race is most of what there is, it is seen well enough.
    const parts = [['', first, last], ...data.races.map(([start, end, number]) => {
      const margin = (end - start) * 0.03;
      return ['Race ' + number, Math.max(first, start - margin), Math.min(last, end + margin)];
    }).filter(([, start, end]) => end > start && end - start < 0.6 * (last - first))];
    element('pictures').replaceChildren(...parts.flatMap(([name, start, end]) =>
      Array.from({length: Math.ceil(data.lanes.length / SHEET) || 1}, (_, n) => {
        const figure = document.createElement('figure');
        const sheet = timeline(start, end, data.lanes.slice(n * SHEET, (n + 1) * SHEET), true);
        sheet.scale(start, end, 1200);
        figure.append(Object.assign(document.createElement('h3'), {textContent: name}), sheet.whole);
        return figure;
      })));
  });

  // ----- what is under the pointer -----------------------------------------------------------

  let chosen = null;
  const choose = (item) => {
    if (chosen) chosen.classList.remove('chosen');
    chosen = item;
    if (!item) return;
    item.classList.add('chosen');
    detail.textContent = item.describe();
  };
  const timeAt = (px) => {
    const box = plot.getBoundingClientRect();
    return to - (box.right - px) / room() * (to - from);
  };
  let grabbed = null;
  plot.addEventListener('pointerdown', (event) => { grabbed = [event.clientX, plot.scrollLeft]; });
  for (const kind of ['pointerup', 'pointercancel']) {
    window.addEventListener(kind, () => { grabbed = null; });
  }
  plot.addEventListener('pointermove', (event) => {
    if (grabbed) plot.scrollLeft = grabbed[1] + grabbed[0] - event.clientX;
    const item = event.target.closest('.item');
    choose(item);
    tip.hidden = !item;
    if (!item) return;
    tip.textContent = cut(detail.textContent, 700);
    const {clientX: left, clientY: top} = event;
    tip.style.left = Math.max(0, Math.min(left + 14, window.innerWidth - tip.offsetWidth - 4)) + 'px';
    tip.style.top = (top + 18 + tip.offsetHeight > window.innerHeight ?
      Math.max(0, top - tip.offsetHeight - 12) : top + 18) + 'px';
  });
  plot.addEventListener('pointerleave', () => { tip.hidden = true; });
  plot.addEventListener('wheel', (event) => {
    if (event.shiftKey || (!event.ctrlKey && document.activeElement !== plot)) return;
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) return;
    event.preventDefault();
    zoom(Math.exp(Math.max(-200, Math.min(200, event.deltaY)) / 400), Math.max(from, timeAt(event.clientX)));
  }, {passive: false});

  // ----- by key ------------------------------------------------------------------------------

  let row = 0, place = -1, now = null;
  const go = () => {
    const {name, items} = lines[row];
    tip.hidden = true;
    place = Math.min(Math.max(place, 0), items.length - 1);
    choose(items[place]);
    if (!items.length) { detail.textContent = name + ': nothing'; return; }
    now = items[place].at;
    bring(now);
  };
  const change = (step) => {
    row = Math.min(Math.max(row + step, 0), lines.length - 1);
    place = now === null ? 0 : lines[row].items.findLastIndex((each) => each.at <= now);
    go();
  };
  plot.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const middle = now === null ? (from + to) / 2 : Math.min(Math.max(now, from), to);
    const keys = {
      '+': () => zoom(0.5, middle), '=': () => zoom(0.5, middle), '-': () => zoom(2, middle),
      Home: () => show(first, last),
      ArrowLeft: () => { place--; go(); }, ArrowRight: () => { place++; go(); },
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

  // ----- the table ---------------------------------------------------------------------------

  const HIGH = 30, BEYOND = 10;
  const box = element('scroll'), rows = element('rows'), found = element('found');
  const kart = element('kart'), kind = element('kind'), words = element('find');
  let matching = data.events, opened = null, painted = '';

  const sentenceOf = (event) => (event[8] ? event[8] + ': ' : '') + event[6] +
    (event[7] ? ' [' + event[7] + ']' : '');
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
  const rowOf = (event) => {
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
    const wanted = start + '-' + end + '-' + opened;
    if (!anyway && wanted === painted) return;
    painted = wanted;
    rows.replaceChildren(space(start * HIGH), ...matching.slice(start, end).map(rowOf),
      space((matching.length - end) * HIGH));
  };
  box.addEventListener('scroll', () => fill(false));
  rows.addEventListener('click', (event) => {
    const line = event.target.closest('tr[data-sequence]');
    if (!line) return;
    const sequence = Number(line.dataset.sequence);
    opened = opened === sequence ? null : sequence;
    fill(true);
    now = bySequence.get(sequence)[2];
    bring(now);
  });
  for (const each of [kart, kind]) each.addEventListener('change', filter);
  words.addEventListener('input', filter);
  new ResizeObserver(() => fill(false)).observe(box);
  filter();
})();
