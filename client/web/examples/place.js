// Where on Earth a session's world lies: at ?at=LON,LAT[,HEIGHT], otherwise where its map says, otherwise near Innsbruck.
const asked = new URLSearchParams(location.search);
export const session = `/v1/sessions/${asked.get('session') ?? 'default'}`;

export async function findPlace() {
  const tiles = asked.has('at') ? undefined : await fetch(`${session}/heights/tiles.json`);
  if (tiles?.ok) {
    const [west, south, east, north] = (await tiles.json()).bounds;
    return { at: '', longitude: (west + east) / 2, latitude: (south + north) / 2, height: 0 };
  }
  const at = asked.get('at') ?? '11.39,47.27,0';
  const [longitude, latitude, height = 0] = at.split(',').map(Number);
  return { at, longitude, latitude, height };
}
