// The dialog of worlds: those of the server, and one of one's own.

import { element } from './notices';

export class Worlds {
  private readonly dialog = element<HTMLDialogElement>('worlds');

  constructor(private readonly goTo: (session: string, terrain: string, seed: string) => void) {
    element('make').addEventListener('submit', (event) => {
      event.preventDefault();
      const form = new FormData(event.target as HTMLFormElement);
      this.leave(String(form.get('session')), String(form.get('terrain')), String(form.get('seed')));
    });
  }

  async show(current: string | undefined, headers: Record<string, string>): Promise<void> {
    this.dialog.showModal();
    const list = element('sessions');
    list.textContent = 'Asking the server …';
    try {
      const answer = await fetch('./v1/sessions', { headers });
      if (!answer.ok) throw new Error((await answer.text()).trim());
      const { sessions } = (await answer.json()) as { sessions: { name: string; terrain: string; seed: number; members: number }[] };
      list.replaceChildren(
        ...sessions.map((s) => {
          const item = document.createElement('li'), button = document.createElement('button');
          button.textContent = `${s.name}: ${s.terrain}, seed ${s.seed} · ${s.members} here`;
          button.disabled = s.name === current;
          button.addEventListener('click', () => this.leave(s.name, '', ''));
          item.append(button);
          return item;
        }),
      );
    } catch (error) {
      list.textContent = `The server does not list its sessions. ${error instanceof Error ? error.message : ''}`;
    }
  }

  private leave(session: string, terrain: string, seed: string): void {
    this.dialog.close();
    this.goTo(session, terrain, seed);
  }
}
