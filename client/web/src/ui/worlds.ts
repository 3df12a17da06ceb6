// The dialog of worlds and places: a place to jump to, the server's sessions, and a world of one's own of the server's terrains.

import { element } from './notices';
import { Panel } from './panel';

/** A world to go to; an empty terrain: the session that there is. */
export interface World {
  session: string;
  terrain: string;
  seed: string;
  parameters: string[]; // NAME=NUMBER
  clock: string;
}

interface Terrain {
  name: string;
  summary: string;
  parameters: { name: string; default: number; least: number; most: number; unit: string; summary: string }[];
}

export class Worlds {
  private readonly panel = new Panel('worlds');
  private readonly form = element<HTMLFormElement>('make');
  private readonly choice = this.form.querySelector('select')!;
  private terrains: Terrain[] = [];

  constructor(private readonly on: { goTo: (world: World) => void; jump: (to: string) => boolean }) {
    this.choice.addEventListener('change', () => this.showParameters());
    this.form.addEventListener('submit', (event) => {
      event.preventDefault();
      this.make(new FormData(this.form));
    });
    const field = element('jump').querySelector('input')!;
    field.addEventListener('input', () => field.setCustomValidity(''));
    element('jump').addEventListener('submit', (event) => {
      event.preventDefault();
      if (this.on.jump(field.value)) return this.panel.close();
      field.setCustomValidity('Two numbers, x and z in metres, or a link to a place.');
      field.reportValidity();
    });
  }

  async toggle(current: string | undefined, headers: Record<string, string>): Promise<void> {
    if (!this.panel.toggle()) return;
    const list = element('sessions'), state = element('asking'), ask = async (path: string): Promise<unknown> => {
      const answer = await fetch(path, { headers });
      if (!answer.ok) throw new Error((await answer.text()).trim());
      return answer.json();
    };
    const say = (sentence: string): void => {
      state.textContent = sentence;
      state.hidden = sentence === '';
      list.hidden = sentence !== '';
    };
    say('Asking the server …');
    try {
      const { sessions } = (await ask('./v1/sessions')) as { sessions: { name: string; terrain: string; seed: number; members: number }[] };
      list.replaceChildren(
        ...sessions.map((s) => {
          const item = document.createElement('li'), button = document.createElement('button');
          button.textContent = `${s.name}: ${s.terrain}, seed ${s.seed} · ${s.members} here`;
          button.disabled = s.name === current;
          button.addEventListener('click', () => this.leave({ session: s.name, terrain: '', seed: '', parameters: [], clock: '' }));
          item.append(button);
          return item;
        }),
      );
      say('');
      this.offer(((await ask('./v1/terrains')) as { terrains: Terrain[] }).terrains);
    } catch (error) {
      say(`The server does not list its worlds. ${error instanceof Error ? error.message : ''}`);
    }
  }

  private offer(terrains: Terrain[]): void {
    const chosen = this.choice.value;
    this.terrains = terrains;
    this.choice.replaceChildren(...terrains.map(({ name }) => new Option(name, name, false, name === chosen)));
    this.form.closest('details')!.hidden = terrains.length === 0; // the server makes no sessions
    this.showParameters();
  }

  private showParameters(): void {
    const terrain = this.terrains.find(({ name }) => name === this.choice.value);
    this.choice.title = terrain?.summary ?? '';
    element('parameters').replaceChildren(
      ...(terrain?.parameters ?? []).map((p) => {
        const label = document.createElement('label'), field = document.createElement('input'), about = document.createElement('small');
        Object.assign(field, { name: `param ${p.name}`, type: 'number', step: 'any', min: p.least, max: p.most, placeholder: String(p.default) });
        about.textContent = `${p.summary}, ${p.least} to ${p.most} ${p.unit}`;
        label.append(p.name, field, about);
        return label;
      }),
    );
  }

  private make(form: FormData): void {
    const value = (name: string): string => String(form.get(name));
    const parameters = [...form.keys()].filter((name) => name.startsWith('param ') && value(name) !== '').map((name) => `${name.slice(6)}=${value(name)}`);
    this.leave({ session: value('session'), terrain: value('terrain'), seed: value('seed'), parameters, clock: '' });
  }

  private leave(world: World): void {
    this.panel.close();
    this.on.goTo(world);
  }
}
