"use strict";
const everything = (selector) => [...document.querySelectorAll(selector)];
const tools = document.getElementById("tools");
const search = document.getElementById("search");
const tag = document.getElementById("tag");
const shown = document.getElementById("shown");
const entries = everything("[data-verdict]");
const words = new Map(entries.map((entry) => [entry, entry.textContent.toLowerCase()]));
let verdict = "";

function filter() {
  const wanted = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  let rows = 0;
  for (const entry of entries) {
    const fits =
      (!verdict || entry.dataset.verdict === verdict) &&
      (!tag.value || JSON.parse(entry.dataset.tags).includes(tag.value)) &&
      wanted.every((word) => words.get(entry).includes(word));
    entry.hidden = !fits;
    if (fits && entry.tagName === "TR") rows += 1;
  }
  shown.textContent = `${rows} of ${entries.filter((entry) => entry.tagName === "TR").length} cases`;
}

function choose(button) {
  verdict = button.value;
  for (const other of everything("#tools button[name=verdict]")) {
    other.setAttribute("aria-pressed", String(other === button));
  }
  filter();
}

function openTarget() {
  const target = location.hash && document.getElementById(location.hash.slice(1));
  const details = target && target.closest("details");
  if (details) {
    details.hidden = false;
    details.open = true;
    details.scrollIntoView();
  }
}

for (const button of everything("#tools button[name=verdict]")) button.addEventListener("click", () => choose(button));
for (const button of everything("button[name=open]")) {
  button.addEventListener("click", () => {
    for (const details of everything("details.case:not([hidden])")) details.open = button.value === "all";
  });
}
search.addEventListener("input", filter);
tag.addEventListener("change", filter);
window.addEventListener("hashchange", openTarget);
everything("[data-script]").forEach((element) => (element.hidden = false));
tools.hidden = false;
filter();
openTarget();
