// What the page says to people: a problem in its middle, a note at its edge, and how the connection stands.

export function element<T extends HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}

export class Notices {
  private timer = 0;
  private isFatal = false;
  private isAside = true; // what the note says

  /** Stays: nothing that is said later takes its place. */
  fatal(title: string, sentence: string): void {
    this.light('off', 'not connected');
    this.note('', 0);
    this.problem(title, sentence);
    this.isFatal = true;
  }

  problem(title: string, sentence: string, offer: 'nothing' | 'token' | 'again' = 'nothing'): void {
    if (this.isFatal) return;
    const box = element('problem');
    box.querySelector('h2')!.textContent = title;
    box.querySelector('p')!.textContent = sentence;
    element('token').hidden = offer !== 'token';
    element('again').hidden = offer !== 'again';
    box.hidden = false;
  }
  noProblem(): void {
    element('problem').hidden = !this.isFatal;
  }

  /** For so long; 0: until the next one. */
  note(sentence: string, ms = 2500): void {
    this.say(sentence, ms, false);
  }
  /** The same, of less weight: it takes the place of other asides alone. */
  aside(sentence: string, ms: number): void {
    if (this.isAside || element('note').hidden) this.say(sentence, ms, true);
  }

  private say(sentence: string, ms: number, isAside: boolean): void {
    if (this.isFatal) return;
    this.isAside = isAside;
    const box = element('note');
    box.textContent = sentence;
    box.hidden = sentence === '';
    clearTimeout(this.timer);
    if (ms > 0) this.timer = window.setTimeout(() => (box.hidden = true), ms);
  }

  light(state: 'on' | 'wait' | 'off', text: string): void {
    if (this.isFatal) return;
    element('light').dataset['state'] = state;
    element('world').textContent = text;
  }
}
