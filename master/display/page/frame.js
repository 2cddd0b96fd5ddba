// Frames as they are sent: a JSON header and the images of stripes (PROTOCOL.md, "frames"). No DOM.

/// A message that is not a frame.
export class FrameError extends Error {}

/// Limit of a header in bytes: the owners of all tiles of 64 million pixels take less.
const MOST_HEADER_BYTES = 16 << 20;

/// Splits a message: {header, images}; images[i] is the Uint8Array of header.stripes[i], inside `buffer`.
/// Errors: FrameError.
export function parseFrame(buffer) {
  if (buffer.byteLength < 4) throw new FrameError('no header');
  const headerBytes = new DataView(buffer).getUint32(0, true);
  if (headerBytes > Math.min(MOST_HEADER_BYTES, buffer.byteLength - 4)) throw new FrameError('header too long');
  let header;
  try {
    header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, headerBytes)));
  } catch {
    throw new FrameError('header is no JSON');
  }
  if (!Array.isArray(header?.stripes) || !Array.isArray(header.size)) throw new FrameError('incomplete header');
  let offset = 4 + headerBytes;
  const images = header.stripes.map(({ bytes }) => {
    if (!Number.isInteger(bytes) || bytes < 0 || bytes > buffer.byteLength - offset) throw new FrameError('short stripe');
    const image = new Uint8Array(buffer, offset, bytes);
    offset += bytes;
    return image;
  });
  return { header, images };
}

/// A share as a percentage, with two digits.
export const percent = (share) => `${Number((share * 100).toPrecision(2))} %`;
const count = (n, one, many) => `${n.toLocaleString('en')} ${n === 1 ? one : many}`;

/// The noise that the picture has reached, in words, if it is to be shown.
function noiseOf({ noise, noise_wanted: wanted }) { return noise > 0 && wanted > 0 ? [`noise ${percent(noise)}, wanted ${percent(wanted)}`] : []; }

/// A frame's state, in words for people; `isNewest`: it shows the view that was sent last; `isMoving`: more follow.
/// Returns {text, kind}; kind is 'exact', 'refining' or 'moving'.
export function describe(header, isNewest, isMoving) {
  if (header.exact) return isNewest ? { text: ['exact', ...noiseOf(header)].join(' · '), kind: 'exact' } : { text: 'the new view is being rendered', kind: 'moving' };
  const parts = [];
  if (isMoving) parts.push('in motion');
  else if (header.traced < 1) parts.push(`getting sharper: ${Math.floor(header.traced * 100)} %`);
  else parts.push(`getting smoother: ${header.samples} of ${count(header.spp, 'sample', 'samples')}`, ...noiseOf(header));
  if (header.waiting > 0) parts.push('data is loading');
  return { text: parts.join(' · '), kind: header.traced < 1 ? 'moving' : 'refining' };
}
