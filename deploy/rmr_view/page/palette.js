// Colours of the page. The first six of robots are Okabe and Ito's, which people with any common kind of colour vision
// tell apart; six more were chosen as far as possible from these, from each other, and from the floor of both themes.
//
// Robots take the twelve by their place in the roster. Vermillion is kept for what went wrong: missed deadlines,
// lost frames, faults. Nothing rests on colour alone: robots have numbers, misses have a shape.

export const ALERT = "#D55E00";

const ROBOTS = [
  "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#F0E442",
  "#1010F0", "#401080", "#10F070", "#E030F0", "#E01050", "#605010",
];

const LIGHT = {
  dark: false,
  ground: "#eceff3",
  floor: "#ffffff",
  grid: "#eef0f3",
  wall: "#8d97a3",
  obstacle: "#cdd4dc",
  obstacleEdge: "#a9b3bf",
  area: "#7b8794",
  areaFill: "rgba(0, 114, 178, 0.05)",
  text: "#1a1f26",
  muted: "#5c6773",
  line: "#dfe3e8",
  lane: "#f3f5f7",
  panel: "#ffffff",
  accent: "#0072B2",
  alert: "#C24E00",
  good: "#00795a",
  halo: "rgba(255, 255, 255, 0.9)",
  shade: "rgba(20, 30, 45, 0.14)",
};

const DARK = {
  dark: true,
  ground: "#0e1116",
  floor: "#171c23",
  grid: "#1e242c",
  wall: "#5a6573",
  obstacle: "#323b47",
  obstacleEdge: "#4a5564",
  area: "#8793a1",
  areaFill: "rgba(86, 180, 233, 0.06)",
  text: "#e7ebf0",
  muted: "#97a3b0",
  line: "#2a323c",
  lane: "#1c2129",
  panel: "#161b22",
  accent: "#56B4E9",
  alert: "#FF8A3D",
  good: "#2fbf95",
  halo: "rgba(14, 17, 22, 0.9)",
  shade: "rgba(0, 0, 0, 0.4)",
};

const prefersDark = matchMedia("(prefers-color-scheme: dark)");
const KEPT = "rmr.theme";
const listeners = new Set();
let choice = kept();

function kept() {
  try {
    return localStorage.getItem(KEPT);
  } catch {
    return null; // storage is switched off: the choice lasts as long as the page
  }
}

/** Return the colours of the present theme. */
export function theme() {
  return isDark() ? DARK : LIGHT;
}

export function isDark() {
  return choice ? choice === "dark" : prefersDark.matches;
}

/** Change from light to dark or back; the choice is kept in this browser. */
export function toggleTheme() {
  choice = isDark() ? "light" : "dark";
  try {
    localStorage.setItem(KEPT, choice);
  } catch {
    // see kept()
  }
  apply();
}

export function onTheme(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

function apply() {
  document.documentElement.dataset.theme = isDark() ? "dark" : "light";
  listeners.forEach((listener) => listener());
}

prefersDark.addEventListener("change", apply);
apply();

const places = new Map();

/** Tell the palette the roster: a robot's hue depends on its place in it. */
export function setRoster(robots) {
  places.clear();
  robots.forEach((robot, place) => places.set(robot, place));
}

export function robotColour(robot) {
  return ROBOTS[(places.get(robot) ?? robot) % ROBOTS.length];
}

/** Return black or white, whichever reads better on `colour` (#rrggbb). */
export function inkOn(colour) {
  const [r, g, b] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255);
  return 0.299 * r + 0.587 * g + 0.114 * b > 0.5 ? "#14181d" : "#ffffff";
}

/** Return `colour` (#rrggbb) with an opacity of 0 to 1. */
export function faded(colour, alpha) {
  const value = Math.round(Math.min(1, Math.max(0, alpha)) * 255);
  return colour + value.toString(16).padStart(2, "0");
}
