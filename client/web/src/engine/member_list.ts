// The others in the session, from what the server tells of who came, moved and went.

import type { Members, Moved } from '../generated/ridgecast/v1/stream_pb';
import type { MemberTold } from '../messages';

const at = (moved: Moved | undefined): MemberTold['at'] => moved?.pose && { x: Number(moved.pose.x), y: moved.pose.y, z: Number(moved.pose.z) };

export class MemberList {
  private readonly members = new Map<string, MemberTold>();

  know({ left, joined, moved }: Members): void {
    for (const camera of left) this.members.delete(String(camera));
    for (const member of joined) this.members.set(String(member.camera), { camera: String(member.camera), name: new TextDecoder().decode(member.name), at: at(member.moved) });
    for (const one of moved) {
      const member = this.members.get(String(one.camera));
      if (member) member.at = at(one);
    }
  }
  clear(): void {
    this.members.clear();
  }
  get all(): MemberTold[] {
    return [...this.members.values()];
  }
}
