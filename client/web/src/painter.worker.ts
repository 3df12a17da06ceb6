// The painter's thread: see render/painter.ts.

import type { FromPainter, ToPainter } from './messages';
import { Painter } from './render/painter';

const page = self as unknown as { postMessage(message: FromPainter): void; onmessage: ((event: MessageEvent<ToPainter>) => void) | null };
let painter: Painter | undefined;
page.onmessage = ({ data }) => {
  if (data.kind === 'begin') painter = Painter.begin(data, (message) => page.postMessage(message));
  else painter?.hear(data);
};
