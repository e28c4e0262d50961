// Reads the numbers of the page.

const UNKNOWN = -(2 ** 31);

/** Numbers that `packing.py` has written: base64 of deflated differences of integers; NaN where nothing is known. */
async function unpack({ data, decimals, offset = 0 }) {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const steps = new DataView(await new Response(stream).arrayBuffer());
  const scale = 10 ** decimals;
  const values = new Float64Array(steps.byteLength / 4);
  let count = 0;
  for (let i = 0; i < values.length; i++) {
    count = (count + steps.getInt32(4 * i, true)) | 0;
    values[i] = count === UNKNOWN ? NaN : offset + count / scale;
  }
  return values;
}

/** The page's data with all numbers unpacked in place. */
async function loadPage() {
  const page = JSON.parse(document.getElementById("data").textContent);
  const work = [];
  const unpackInto = (owner, name) => {
    if (!owner[name]) return;
    owner[`${name}Decimals`] = owner[name].decimals;
    work.push(unpack(owner[name]).then((values) => (owner[name] = values)));
  };
  for (const drive of page.drives) {
    unpackInto(drive, "time");
    unpackInto(drive, "way");
    if (drive.track) {
      for (const name of ["x", "y", "heading", "reference_x", "reference_y"]) unpackInto(drive.track, name);
      for (const name of ["x", "y"]) unpackInto(drive.track.paths, name);
    }
  }
  for (const plot of page.plots) for (const curve of plot.curves) unpackInto(curve, "values");
  await Promise.all(work);
  return page;
}

/** The place of the last number that is not above `value`, in numbers that never decrease; −1 where there is none. */
function lastAt(numbers, value) {
  let low = 0;
  let high = numbers.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (numbers[middle] <= value) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim() || "#888888";
const minus = (text) => text.replace("-", "−");

/** A number with so many decimals, never −0; a dash where it is unknown. */
function figure(value, digits) {
  if (!Number.isFinite(value)) return "–";
  return minus((Math.abs(value) < 0.5 * 10 ** -digits ? 0 : value).toFixed(digits));
}

/** An element with attributes and children; text is never read as markup. */
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

function saveBlob(blob, name) {
  const link = element("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
