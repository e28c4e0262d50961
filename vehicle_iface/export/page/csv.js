// The window of time as CSV.

/** All rows between the edges of the plots; an empty cell where nothing is known. */
function windowAsCsv(view) {
  const { drives, plots } = view.page;
  const curves = plots.flatMap((plot) => plot.curves);
  const keys = [...new Set(curves.map((curve) => curve.key))];
  const lines = [[...leadingNames(view.page), ...keys].join(",")];
  drives.forEach((drive, number) => {
    const columns = keys.map((key) => curves.find((curve) => curve.drive === number && curve.key === key));
    const axis = view.axisOf(drive);
    for (let row = lastAt(axis, view.from - 1e-9) + 1; row < axis.length && axis[row] <= view.to + 1e-9; row++) {
      const values = columns.map((curve) => (curve ? cell(curve.values, row, curve.valuesDecimals) : ""));
      lines.push([...leadingCells(view.page, drive, row), ...values].join(","));
    }
  });
  return lines.join("\n") + "\n";
}

/** The columns in front of those of the curves: which drive, when, where, and in which state. */
function leadingNames({ drives, has_way }) {
  const names = drives.length > 1 ? ["drive", "time_s"] : ["time_s"];
  if (has_way) names.push("way_m");
  names.push("state", "reason");
  return drives.some((drive) => drive.track) ? [...names, "x_m", "y_m", "heading_rad"] : names;
}

function leadingCells({ drives, has_way }, drive, row) {
  const cells = drives.length > 1 ? [drive.label.replaceAll(/[",\n]/g, " ")] : [];
  cells.push(cell(drive.time, row, drive.timeDecimals));
  if (has_way) cells.push(cell(drive.way, row, drive.wayDecimals));
  const { state, reason } = stateAt(drive, row);
  cells.push(state, reason);
  if (!drives.some((one) => one.track)) return cells;
  const { track } = drive;
  return [...cells, ...["x", "y", "heading"].map((name) => (track ? cell(track[name], row, track[`${name}Decimals`]) : ""))];
}

function cell(values, row, decimals) {
  return values && Number.isFinite(values[row]) ? values[row].toFixed(decimals) : "";
}
