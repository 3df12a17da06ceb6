float f0(float x) { return x + 1.0; }
float f1(float x) { return f0(x) + f0(x * 0.5); }
float f2(float x) { return f1(x) + f1(x * 0.5); }
float f3(float x) { return f2(x) + f2(x * 0.5); }
float f4(float x) { return f3(x) + f3(x * 0.5); }
float f5(float x) { return f4(x) + f4(x * 0.5); }
float f6(float x) { return f5(x) + f5(x * 0.5); }
float f7(float x) { return f6(x) + f6(x * 0.5); }
float f8(float x) { return f7(x) + f7(x * 0.5); }
float f9(float x) { return f8(x) + f8(x * 0.5); }
float f10(float x) { return f9(x) + f9(x * 0.5); }
float f11(float x) { return f10(x) + f10(x * 0.5); }
float f12(float x) { return f11(x) + f11(x * 0.5); }
float f13(float x) { return f12(x) + f12(x * 0.5); }
float f14(float x) { return f13(x) + f13(x * 0.5); }
float f15(float x) { return f14(x) + f14(x * 0.5); }
float f16(float x) { return f15(x) + f15(x * 0.5); }
float f17(float x) { return f16(x) + f16(x * 0.5); }
float f18(float x) { return f17(x) + f17(x * 0.5); }
float f19(float x) { return f18(x) + f18(x * 0.5); }
float f20(float x) { return f19(x) + f19(x * 0.5); }
float f21(float x) { return f20(x) + f20(x * 0.5); }
float f22(float x) { return f21(x) + f21(x * 0.5); }
float f23(float x) { return f22(x) + f22(x * 0.5); }
float f24(float x) { return f23(x) + f23(x * 0.5); }
float f25(float x) { return f24(x) + f24(x * 0.5); }
float f26(float x) { return f25(x) + f25(x * 0.5); }
float f27(float x) { return f26(x) + f26(x * 0.5); }
float f28(float x) { return f27(x) + f27(x * 0.5); }
float f29(float x) { return f28(x) + f28(x * 0.5); }
float f30(float x) { return f29(x) + f29(x * 0.5); }
float f31(float x) { return f30(x) + f30(x * 0.5); }
float f32(float x) { return f31(x) + f31(x * 0.5); }
float f33(float x) { return f32(x) + f32(x * 0.5); }
float f34(float x) { return f33(x) + f33(x * 0.5); }
float f35(float x) { return f34(x) + f34(x * 0.5); }
float f36(float x) { return f35(x) + f35(x * 0.5); }
float f37(float x) { return f36(x) + f36(x * 0.5); }
float f38(float x) { return f37(x) + f37(x * 0.5); }
float f39(float x) { return f38(x) + f38(x * 0.5); }
float f40(float x) { return f39(x) + f39(x * 0.5); }
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  return f40(fraction.x);
}

vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  return vec3(0.3, 0.3, 0.2);
}
