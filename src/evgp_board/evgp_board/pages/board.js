// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

// Shows what the board sends, and sends nothing back. Each message contains everything to show.
// Times are in seconds.
'use strict';

const STALE = 2; // time without a message after which the page shows that it is out of date
const RETRY = 4; // time after which the page reconnects, because some browsers give up

const page = document.body.classList[0];
const kart = location.pathname.split('/')[2];
const what = page === 'kart' ? kart : page === 'results' ? page : 'board';
const element = (id) => document.getElementById(id);
let source = null;
let tried = 0;
let wait = RETRY;
let last = null; // the last message
let came = { steady: 0, wall: 0 }; // when the message was sent, by two clocks of this browser
let least = Infinity; // the smallest difference between our clock and the board's
let drawn = '';

// A phone's steady clock may stop while it sleeps, and its wall clock may be set.
function age() {
  return Math.max(performance.now() / 1000 - came.steady, Date.now() / 1000 - came.wall);
}

function connect() {
  if (source) source.close();
  tried = performance.now() / 1000;
  wait = RETRY * (1 + Math.random()); // not all at once
  source = new EventSource(`/live/${what}`);
  source.onopen = () => { least = Infinity; };
  source.onmessage = (event) => take(JSON.parse(event.data));
}

function take(message) {
  const steady = performance.now() / 1000;
  const difference = steady - message.times.t;
  least = Math.min(least, difference);
  const late = difference - least;
  came = { steady: steady - late, wall: Date.now() / 1000 - late };
  last = message;
  draw();
}

function put(id, text) {
  if (element(id).textContent !== text) element(id).textContent = text;
}

function made(kind, name, ...parts) {
  const node = document.createElement(kind);
  node.className = name;
  node.append(...parts);
  return node;
}

const pad = (number) => String(number).padStart(2, '0');

// A message from before midnight may be shown after it.
const timeOfDay = (seconds) => new Date(1000 * seconds).toISOString().slice(11, 19);

function clock(seconds, digits = 0) {
  const whole = Math.floor(Math.max(0, seconds));
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  const tenths = digits ? `.${Math.floor((seconds % 1) * 10)}` : '';
  return `${hours ? `${hours}:${pad(minutes)}` : minutes}:${pad(whole % 60)}${tenths}`;
}

// Makes symbols appear as text, not as coloured pictures.
const symbol = (text) => text.replace(/[▶⚑■▦⌂⚠]/gu, '$&\uFE0E');

function row(each) {
  const plate = made('a', 'plate', String(each.kart));
  plate.href = `/kart/${each.kart}`;
  const team = made('span', 'team', made('b', '', each.team), made('small', '', each.note));
  const cells = each.cells.map((text) => made('span', 'cell', String(text)));
  const parts = [made('b', 'place', String(each.place)), plate, team, ...cells];
  if (each.tone) parts.push(made('i', `chip ${each.tone}`, symbol(each.symbol)));
  if (each.more) parts.push(made('small', 'more', each.more));
  return made('div', 'row', ...parts);
}

function table(show) {
  const rows = show.rows || [];
  const two = page === 'board' && rows.length > 10;
  document.body.classList.toggle('two', two);
  document.body.style.setProperty('--rows', Math.max(1, two ? Math.ceil(rows.length / 2) : rows.length));
  element('rows').replaceChildren(...rows.map(row));
  const heads = ['', 'Kart', 'Team', ...(show.columns || [])];
  const line = () => made('div', 'row', ...heads.map((text) => made('span', 'cell', text)));
  element('columns').replaceChildren(...(rows.length ? [line(), ...(two ? [line()] : [])] : []));
  const pair = (name) => ([text, value]) => made('div', name, made('span', '', text), made('b', '', value));
  element('cells').replaceChildren(...(show.cells || []).map(pair('card')));
  element('list').replaceChildren(...(show.list || []).map(pair('line')));
}

function draw() {
  const silent = last ? age() : Infinity;
  const lost = silent > STALE;
  const show = last ? last.show : { head: '…', title: '', sub: '', tone: 'faint' };
  document.body.classList.toggle('stale', lost || show.stale);
  let { head, detail } = show;
  if (lost) {
    head = last ? 'NO CONNECTION' : 'CONNECTING …';
    detail = last ? `Nothing heard for ${clock(silent)}. Last: ${show.head}` : '';
  } else if (last) {
    detail = detail.replace('{age}', clock(last.times.age + silent));
  }
  element('state').className = lost ? 'faint' : show.tone;
  element('state').classList.toggle('long', head.length > 15);
  put('head', symbol(head));
  put('detail', detail || '');
  put('live', lost ? '○ not up to date' : show.stale ? '○ race control is silent' : '● live');
  if (!last) return;
  const { green, day } = last.times;
  put('clock', lost || green === null ? '' : clock(green + silent, page === 'board'));
  put('day', lost || day === null ? '' : timeOfDay(day + silent));
  const text = JSON.stringify(show);
  if (text === drawn) return;
  drawn = text;
  for (const id of ['number', 'title', 'sub', 'alert', 'race', 'banner']) put(id, symbol(show[id] || ''));
  element('banner').hidden = !show.banner;
  document.title = `${show.title} · EVGP race`;
  table(show);
}

setInterval(() => {
  draw();
  const now = performance.now() / 1000;
  if (age() > RETRY && now - tried > wait) connect();
}, 100);
for (const [where, event] of [[document, 'visibilitychange'], [window, 'online']]) {
  where.addEventListener(event, () => { draw(); if (age() > STALE) connect(); });
}
connect();
