// The keys, as the window has them: one table for both (common/keys).

import table from '../../../../common/keys/keys.json';

const rows = table.filter(({ where }) => where !== 'window');

/** KeyboardEvent.code of a row's first stroke, where that is a letter, a digit or a named key. */
function codeOf(action: string): string {
  const named: Record<string, string> = { ';': 'Semicolon', "'": 'Quote' };
  const stroke = rows.find((row) => row.action === action)?.keys.split(' / ')[0] ?? '';
  return /^\d$/.test(stroke) ? `Digit${stroke}` : /^[A-Z]$/.test(stroke) ? `Key${stroke}` : /^[A-Z][a-z]+$/.test(stroke) ? stroke : (named[stroke] ?? '');
}

/** By code, what the keys of these actions do. */
export const byCode = (actions: Record<string, () => void>): Record<string, () => void> =>
  Object.fromEntries(Object.entries(actions).map(([action, act]) => [codeOf(action), act]));

export function listKeys(list: HTMLElement): void {
  for (const { keys, words } of rows) {
    const key = document.createElement('dt'), what = document.createElement('dd');
    key.textContent = keys;
    what.textContent = words;
    list.append(key, what);
  }
}
