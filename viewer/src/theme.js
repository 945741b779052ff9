/** Colours from the style sheet for canvases, so that light and dark are defined in one place. */

import { CanvasTexture, ColorManagement, LinearFilter } from 'three';

// Light is computed in screen colours, because converting every pixel from linear colours is slow
// without a graphics card. It is set here because it must be set before the first colour is
// created.
ColorManagement.enabled = false;

/**
 * Okabe and Ito's colours, told apart by every kind of colour vision; the same in light and dark.
 */
export const RIGHT = '#0072B2';
export const OFF = '#CC79A7';
export const MISSED = '#D55E00';
export const WRONG = '#E69F00';
export const FAULT = MISSED;
export const WARNING = WRONG;
export const DUE = '#56B4E9';

const scheme = matchMedia('(prefers-color-scheme: dark)');

/** The current colours of the style sheet. */
export function theme() {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();
  return {
    paper: colour('paper'),
    shade: colour('shade'),
    line: colour('line'),
    faint: colour('faint'),
    ink: colour('ink'),
    quiet: colour('quiet'),
    takes: [colour('take-a'), colour('take-b')],
  };
}

/** The scene's background: the light above, the floor below. */
export function backdrop() {
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [1, 64];
  const pen = canvas.getContext('2d');
  const style = getComputedStyle(document.documentElement);
  const fade = pen.createLinearGradient(0, 0, 0, 64);
  fade.addColorStop(0, style.getPropertyValue('--sky').trim());
  fade.addColorStop(1, style.getPropertyValue('--floor').trim());
  pen.fillStyle = fade;
  pen.fillRect(0, 0, 1, 64);
  const texture = new CanvasTexture(canvas);
  texture.generateMipmaps = false;
  texture.minFilter = LinearFilter;
  return texture;
}

export function onThemeChange(call) {
  scheme.addEventListener('change', call);
}
