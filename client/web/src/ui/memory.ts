// What this browser remembers of its person, for all tabs; a browser that forbids it remembers nothing.

export function remembered(name: string): string {
  try {
    return localStorage.getItem(name) ?? '';
  } catch {
    return '';
  }
}

export function remember(name: string, value: string): void {
  try {
    localStorage.setItem(name, value);
  } catch {
    // then for this visit alone
  }
}
