/** Canvases with sharp lines at any pixel ratio. */

/** Sizes a canvas to `width` × `height` CSS pixels and returns a cleared context in that unit. */
export function drawingOn(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  const context = canvas.getContext('2d');
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return context;
}

/** A pattern of diagonal lines. */
export function hatching(context, colour, spacing = 5) {
  const ratio = window.devicePixelRatio || 1;
  const tile = document.createElement('canvas');
  const size = Math.round(spacing * ratio);
  tile.width = tile.height = size;
  const pen = tile.getContext('2d');
  pen.strokeStyle = colour;
  pen.lineWidth = 1.3 * ratio;
  // Three lines, so that they meet across the tile's corners.
  for (const shift of [-size, 0, size]) {
    pen.moveTo(shift - 1, size + 1);
    pen.lineTo(shift + size + 1, -1);
  }
  pen.stroke();
  const pattern = context.createPattern(tile, 'repeat');
  pattern.setTransform(new DOMMatrix().scale(1 / ratio));
  return pattern;
}

/** Moves a cursor line, by a transform, which needs no layout. */
export function moveCursor(cursor, x) {
  const transform = `translateX(${x.toFixed(1)}px)`;
  if (cursor.style.transform !== transform) cursor.style.transform = transform;
}
