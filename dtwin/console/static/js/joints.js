// Joints of any arm as displays show them: their names, and the scales of their positions and commands.
export const DASHES = ["—", "– –", "· ·", "– ·", "- -", "··", "— -"];
export const titled = (name) => name.charAt(0).toUpperCase() + name.slice(1);
/** The scale of a position, a fifth wider than its range. */
export function spanOf({ lower, upper }) {
  const [low, high] = [lower ?? -Math.PI, upper ?? Math.PI];
  const room = 0.1 * (high - low);
  return { low: low - room, high: high + room, limits: [lower, upper].filter((value) => value != null && Math.abs(value) < Math.PI - 1e-9) };
}
export function commandOf({ limit }, value) {
  if (limit == null) return { low: -1, high: 1, value };
  return { low: -1.125 * limit, high: 1.125 * limit, value, limits: [-limit, limit] };
}
