// SPDX-License-Identifier: BSD-3-Clause
"use strict";

const byId = (id) => document.getElementById(id);
const say = (id, text) => { byId(id).textContent = text; };

const marks = {
  "idle": "○ idle", "warming-up": "◔ warming up: hold the ball still", "capturing": "● capturing: throw the ball", "throw-seen": "● throw seen", "solving": "◐ solving", "done": "✔ done", "fault": "✖ fault",
};

function sigma(value, goal, unit, scale) {
  if (value === null) return "not known yet";
  const shown = `${(value * scale).toPrecision(3)} ${unit}`;
  return `${value <= goal ? "✔" : "▲"} ${shown}; wanted ${(goal * scale).toPrecision(3)} ${unit}`;
}

const count = (number, thing) => `${number} ${thing}${number === 1 ? "" : "s"}`;

function problems(now) {
  const found = [];
  if (now.fault) found.push(now.fault);
  if (now.calibration_problem) found.push(now.calibration_problem);
  for (const camera of now.cameras) {
    if (camera.error) found.push(`${camera.name}: ${camera.error}`);
    else if (!camera.running) found.push(`${camera.name}: not running`);
    else if (!["clear", "used to learn the background"].includes(camera.view)) found.push(`${camera.name}: the picture is ${camera.view}`);
  }
  return found;
}

function showProblems(found) {
  byId("problems").replaceChildren(...found.map((text) => {
    const item = document.createElement("li");
    item.textContent = "✖ " + text;
    return item;
  }));
  byId("problems-section").hidden = found.length === 0;
}

function figureOf(name) {
  const known = byId("camera-" + name);
  if (known) return known;
  const figure = document.createElement("figure");
  figure.id = "camera-" + name;
  const link = document.createElement("a");
  link.href = `api/v1/cameras/${name}/preview.mjpeg`;
  const image = document.createElement("img");
  image.alt = "no picture of " + name;
  link.append(image);
  figure.append(link, document.createElement("figcaption"));
  byId("cameras").append(figure);
  return figure;
}

function showCamera(camera) {
  const mark = camera.running ? "✔" : "✖";
  const lost = camera.frames_dropped + camera.frames_lost_by_driver + camera.frames_damaged;
  figureOf(camera.name).lastChild.textContent =
    `${mark} ${camera.name}: ${camera.frames_per_s}/s, ${count(camera.flights, "flight")}` + (lost ? `, ${count(lost, "frame")} lost` : "");
}

function show(now) {
  say("state", marks[now.state] || now.state);
  say("throws", now.throws);
  say("verdict", now.verdict || "none yet");
  say("position", sigma(now.worst_sigma_position_m, now.target.position_m, "mm", 1e3));
  say("rotation", sigma(now.worst_sigma_rotation_rad, now.target.rotation_rad, "mrad", 1e3));
  say("advice", now.advice || now.reasons.join("; "));
  say("software", now.software);
  showProblems(problems(now));
  now.cameras.forEach(showCamera);
  showKept(now).catch(() => { kept = ""; });
}

function sessionItem(session) {
  const item = document.createElement("li");
  if (session.problem || ["done", "aborted", "interrupted"].includes(session.state)) {
    const link = document.createElement("a");
    link.href = `api/v1/sessions/${session.session}/file`;
    link.download = session.file;
    link.textContent = session.file;
    item.append(link);
  } else {
    item.append(session.file);
  }
  const facts = session.problem ? [session.problem] : [session.started_utc.replace(/[TZ]/g, " ").trim(), session.state, count(session.throws, "throw"), session.verdict || "no verdict"];
  item.append(` ${[...facts, `${(session.bytes / 1e6).toFixed(1)} MB`].join(", ")}`);
  return item;
}

// What the box keeps, asked for when something of it has changed.
const newestSessions = 5;
let kept = "";
async function showKept(now) {
  const is = [now.session, now.state, now.calibration, now.calibration_problem].join();
  if (is === kept) return;
  kept = is;
  const [sessions, calibrations] = await Promise.all(["sessions", "calibration"].map(async (name) => (await fetch("api/v1/" + name)).json()));
  byId("sessions").replaceChildren(...sessions.slice(0, newestSessions).map(sessionItem));
  byId("sessions-section").hidden = sessions.length === 0;
  const hasCalibration = calibrations.length > 0 && !now.calibration_problem;
  byId("calibration").hidden = !hasCalibration;
  byId("no-calibration").hidden = hasCalibration;
}

async function learnName() {
  const system = await (await fetch("api/v1/system")).json();
  say("unit", system.unit);
  document.title = `throwcal ${system.unit}`;
}

// One picture at a time: a browser opens six connections to a box, and the box serves sixteen.
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
async function showPictures() {
  for (;;) {
    const figures = [...document.querySelectorAll("#cameras figure")];
    const wanted = byId("show-pictures").checked && !document.hidden;
    for (const figure of wanted ? figures : []) {
      const image = figure.querySelector("img");
      await new Promise((resolve) => {
        image.onload = image.onerror = resolve;
        image.src = `api/v1/cameras/${figure.id.slice("camera-".length)}/preview.jpg?${Date.now()}`;
      });
    }
    await pause(figures.length && wanted ? 200 : 1000);
  }
}

async function command(what) {
  const key = [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  const headers = { "Idempotency-Key": key };
  const token = byId("token").value.trim();
  if (/[^!-~]/.test(token)) {  // what no header can carry
    byId("token").focus();
    return "✖ this is not the box's token: it has a character that no token has";
  }
  if (token) headers.Authorization = "Bearer " + token;
  const response = await fetch("api/v1/capture/" + what, { method: "POST", headers });
  const answer = await response.json();
  if (response.ok) return "✔ " + document.querySelector(`button[value=${what}]`).textContent;
  if (response.status === 401) byId("token").focus();
  return "✖ " + answer.error.message;
}

byId("commands").addEventListener("submit", async (event) => {
  event.preventDefault();
  const what = event.submitter ? event.submitter.value : "start";
  say("answer", "…");
  try {
    say("answer", await command(what));
  } catch (error) {
    say("answer", "✖ the box does not answer: " + error.message);
  }
});

const events = new EventSource("api/v1/events");
events.addEventListener("status", (event) => show(JSON.parse(event.data)));
events.onopen = () => learnName().catch(() => {});
events.onerror = () => say("state", "✖ no connection to the box");
showPictures();
