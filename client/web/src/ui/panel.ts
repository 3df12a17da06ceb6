// A list or a text over the picture: the key that opens it closes it, as Esc does, and all other keys go on. One is open at a time.

import { element } from './notices';

const all: Panel[] = [];

export class Panel {
  private readonly dialog: HTMLDialogElement;

  constructor(id: string) {
    this.dialog = element<HTMLDialogElement>(id);
    all.push(this);
  }

  get isOpen(): boolean {
    return this.dialog.open;
  }
  /** Whether it is open then. */
  toggle(): boolean {
    const opens = !this.dialog.open;
    for (const panel of all) panel.close();
    if (opens) this.dialog.show();
    return opens;
  }
  close(): void {
    if (this.dialog.open) this.dialog.close();
  }
}

window.addEventListener('keydown', (event) => {
  if (event.key === 'Escape') for (const panel of all) panel.close();
});
