// Matrices of a user's terrain file; included as text after glsl_extras.h.

// Columns. A constructor takes numbers and vectors in any mixture, one number for the diagonal, or another matrix's corner.
struct mat2 {
  vec2 column0, column1;
  mat2() = default;
  constexpr mat2(vec2 a, vec2 b) : column0(a), column1(b) {}
  constexpr explicit mat2(float d) : column0(d, 0.0f), column1(0.0f, d) {}
  constexpr explicit mat2(const Components<float>& c) : column0(c.at[0], c.at[1]), column1(c.at[2], c.at[3]) {}
  template <class T>
  constexpr explicit mat2(Vector4<T> v) : mat2(Components<float>(v, 0.0f)) {}
  template <class A, class B, class... C>
  constexpr explicit mat2(A a, B b, C... c) : mat2(Components<float>(a, b, c...)) {}
  constexpr vec2& operator[](int i) { return i <= 0 ? column0 : column1; }
  constexpr const vec2& operator[](int i) const { return i <= 0 ? column0 : column1; }
  constexpr explicit operator float() const { return column0.x; }
  constexpr explicit operator vec2() const { return column0; }
  constexpr explicit operator vec3() const { return {column0, column1.x}; }
  constexpr explicit operator vec4() const { return {column0, column1}; }
  constexpr bool operator==(const mat2&) const = default;
};
struct mat3 {
  vec3 column0, column1, column2;
  mat3() = default;
  constexpr mat3(vec3 a, vec3 b, vec3 c) : column0(a), column1(b), column2(c) {}
  constexpr explicit mat3(float d) : column0(d, 0.0f, 0.0f), column1(0.0f, d, 0.0f), column2(0.0f, 0.0f, d) {}
  constexpr explicit mat3(mat2 m) : column0(m.column0, 0.0f), column1(m.column1, 0.0f), column2(0.0f, 0.0f, 1.0f) {}
  constexpr explicit mat3(const Components<float>& c)
      : column0(c.at[0], c.at[1], c.at[2]), column1(c.at[3], c.at[4], c.at[5]), column2(c.at[6], c.at[7], c.at[8]) {}
  template <class A, class B, class... C>
  constexpr explicit mat3(A a, B b, C... c) : mat3(Components<float>(a, b, c...)) {}
  constexpr vec3& operator[](int i) { return i <= 0 ? column0 : i == 1 ? column1 : column2; }
  constexpr const vec3& operator[](int i) const { return i <= 0 ? column0 : i == 1 ? column1 : column2; }
  constexpr explicit operator float() const { return column0.x; }
  constexpr explicit operator vec2() const { return vec2(column0); }
  constexpr explicit operator vec3() const { return column0; }
  constexpr explicit operator vec4() const { return {column0, column1.x}; }
  constexpr explicit operator mat2() const { return {vec2(column0), vec2(column1)}; }
  constexpr bool operator==(const mat3&) const = default;
};
struct mat4 {
  vec4 column0, column1, column2, column3;
  mat4() = default;
  constexpr mat4(vec4 a, vec4 b, vec4 c, vec4 d) : column0(a), column1(b), column2(c), column3(d) {}
  constexpr explicit mat4(float d)
      : column0(d, 0.0f, 0.0f, 0.0f), column1(0.0f, d, 0.0f, 0.0f), column2(0.0f, 0.0f, d, 0.0f), column3(0.0f, 0.0f, 0.0f, d) {}
  constexpr explicit mat4(mat3 m)
      : column0(m.column0, 0.0f), column1(m.column1, 0.0f), column2(m.column2, 0.0f), column3(0.0f, 0.0f, 0.0f, 1.0f) {}
  constexpr explicit mat4(mat2 m) : mat4(mat3(m)) {}
  constexpr explicit mat4(const Components<float>& c)
      : column0(c.at[0], c.at[1], c.at[2], c.at[3]),
        column1(c.at[4], c.at[5], c.at[6], c.at[7]),
        column2(c.at[8], c.at[9], c.at[10], c.at[11]),
        column3(c.at[12], c.at[13], c.at[14], c.at[15]) {}
  template <class A, class B, class... C>
  constexpr explicit mat4(A a, B b, C... c) : mat4(Components<float>(a, b, c...)) {}
  constexpr vec4& operator[](int i) { return i <= 0 ? column0 : i == 1 ? column1 : i == 2 ? column2 : column3; }
  constexpr const vec4& operator[](int i) const { return i <= 0 ? column0 : i == 1 ? column1 : i == 2 ? column2 : column3; }
  constexpr explicit operator float() const { return column0.x; }
  constexpr explicit operator vec2() const { return vec2(column0); }
  constexpr explicit operator vec3() const { return vec3(column0); }
  constexpr explicit operator vec4() const { return column0; }
  constexpr explicit operator mat2() const { return {vec2(column0), vec2(column1)}; }
  constexpr explicit operator mat3() const { return {vec3(column0), vec3(column1), vec3(column2)}; }
  constexpr bool operator==(const mat4&) const = default;
};
using mat2x2 = mat2;
using mat3x3 = mat3;
using mat4x4 = mat4;

constexpr vec2 operator*(mat2 m, vec2 v) { return m.column0 * v.x + m.column1 * v.y; }
constexpr vec3 operator*(mat3 m, vec3 v) { return m.column0 * v.x + m.column1 * v.y + m.column2 * v.z; }
constexpr vec4 operator*(mat4 m, vec4 v) { return m.column0 * v.x + m.column1 * v.y + m.column2 * v.z + m.column3 * v.w; }
constexpr vec2 operator*(vec2 v, mat2 m) { return {dot(v, m.column0), dot(v, m.column1)}; }
constexpr vec3 operator*(vec3 v, mat3 m) { return {dot(v, m.column0), dot(v, m.column1), dot(v, m.column2)}; }
constexpr vec4 operator*(vec4 v, mat4 m) { return {dot(v, m.column0), dot(v, m.column1), dot(v, m.column2), dot(v, m.column3)}; }
#define RIDGECAST_COLUMNS2(each) \
  { each(0), each(1) }
#define RIDGECAST_COLUMNS3(each) \
  { each(0), each(1), each(2) }
#define RIDGECAST_COLUMNS4(each) \
  { each(0), each(1), each(2), each(3) }
#define RIDGECAST_PRODUCT(k) a* b.column##k
#define RIDGECAST_SUM(k) a.column##k + b.column##k
#define RIDGECAST_DIFFERENCE(k) a.column##k - b.column##k
#define RIDGECAST_QUOTIENT(k) a.column##k / b.column##k
#define RIDGECAST_EACH_PRODUCT(k) a.column##k* b.column##k
#define RIDGECAST_NEGATIVE(k) -a.column##k
#define RIDGECAST_SUM_WITH(k) a.column##k + s
#define RIDGECAST_DIFFERENCE_WITH(k) a.column##k - s
#define RIDGECAST_PRODUCT_WITH(k) a.column##k* s
#define RIDGECAST_QUOTIENT_WITH(k) a.column##k / s
#define RIDGECAST_DIFFERENCE_FROM(k) s - a.column##k
#define RIDGECAST_QUOTIENT_OF(k) s / a.column##k
#define RIDGECAST_MATRIX(matrix, vector, columns)                                                 \
  constexpr matrix operator*(matrix a, matrix b) { return columns(RIDGECAST_PRODUCT); }           \
  constexpr matrix operator+(matrix a, matrix b) { return columns(RIDGECAST_SUM); }               \
  constexpr matrix operator-(matrix a, matrix b) { return columns(RIDGECAST_DIFFERENCE); }        \
  constexpr matrix operator/(matrix a, matrix b) { return columns(RIDGECAST_QUOTIENT); }          \
  constexpr matrix matrixCompMult(matrix a, matrix b) { return columns(RIDGECAST_EACH_PRODUCT); } \
  constexpr matrix operator-(matrix a) { return columns(RIDGECAST_NEGATIVE); }                    \
  constexpr matrix operator+(matrix a) { return a; }                                              \
  constexpr matrix operator+(matrix a, float s) { return columns(RIDGECAST_SUM_WITH); }           \
  constexpr matrix operator-(matrix a, float s) { return columns(RIDGECAST_DIFFERENCE_WITH); }    \
  constexpr matrix operator*(matrix a, float s) { return columns(RIDGECAST_PRODUCT_WITH); }       \
  constexpr matrix operator/(matrix a, float s) { return columns(RIDGECAST_QUOTIENT_WITH); }      \
  constexpr matrix operator+(float s, matrix a) { return a + s; }                                 \
  constexpr matrix operator-(float s, matrix a) { return columns(RIDGECAST_DIFFERENCE_FROM); }    \
  constexpr matrix operator*(float s, matrix a) { return a * s; }                                 \
  constexpr matrix operator/(float s, matrix a) { return columns(RIDGECAST_QUOTIENT_OF); }        \
  constexpr matrix divided(matrix a, matrix b) { return a / b; }                                  \
  constexpr matrix divided(matrix a, float s) { return a / s; }                                   \
  constexpr matrix divided(float s, matrix a) { return s / a; }                                   \
  template <class B>                                                                              \
  constexpr matrix& operator+=(matrix& a, B b) {                                                  \
    return a = a + b;                                                                             \
  }                                                                                               \
  template <class B>                                                                              \
  constexpr matrix& operator-=(matrix& a, B b) {                                                  \
    return a = a - b;                                                                             \
  }                                                                                               \
  template <class B>                                                                              \
  constexpr matrix& operator*=(matrix& a, B b) {                                                  \
    return a = a * b;                                                                             \
  }                                                                                               \
  constexpr matrix& operator++(matrix& a) { return a = a + 1.0f; }                                \
  constexpr matrix& operator--(matrix& a) { return a = a - 1.0f; }                                \
  constexpr matrix operator++(matrix& a, int) {                                                   \
    const matrix before = a;                                                                      \
    ++a;                                                                                          \
    return before;                                                                                \
  }                                                                                               \
  constexpr matrix operator--(matrix& a, int) {                                                   \
    const matrix before = a;                                                                      \
    --a;                                                                                          \
    return before;                                                                                \
  }                                                                                               \
  constexpr matrix& operator/=(matrix& a, float b) { return a = a / b; }                          \
  constexpr vector& operator*=(vector& v, matrix m) { return v = v * m; }
RIDGECAST_MATRIX(mat2, vec2, RIDGECAST_COLUMNS2)
RIDGECAST_MATRIX(mat3, vec3, RIDGECAST_COLUMNS3)
RIDGECAST_MATRIX(mat4, vec4, RIDGECAST_COLUMNS4)
#undef RIDGECAST_MATRIX
constexpr mat2 transpose(mat2 m) { return {{m.column0.x, m.column1.x}, {m.column0.y, m.column1.y}}; }
constexpr mat3 transpose(mat3 m) {
  return {{m.column0.x, m.column1.x, m.column2.x}, {m.column0.y, m.column1.y, m.column2.y}, {m.column0.z, m.column1.z, m.column2.z}};
}
constexpr mat4 transpose(mat4 m) {
  return {{m.column0.x, m.column1.x, m.column2.x, m.column3.x},
          {m.column0.y, m.column1.y, m.column2.y, m.column3.y},
          {m.column0.z, m.column1.z, m.column2.z, m.column3.z},
          {m.column0.w, m.column1.w, m.column2.w, m.column3.w}};
}
constexpr mat2 outerProduct(vec2 c, vec2 r) { return {c * r.x, c * r.y}; }
constexpr mat3 outerProduct(vec3 c, vec3 r) { return {c * r.x, c * r.y, c * r.z}; }
constexpr mat4 outerProduct(vec4 c, vec4 r) { return {c * r.x, c * r.y, c * r.z, c * r.w}; }
constexpr vec3 cross(vec3 a, vec3 b) { return {a.y * b.z - b.y * a.z, a.z * b.x - b.z * a.x, a.x * b.y - b.x * a.y}; }
constexpr float determinant(mat2 m) { return m.column0.x * m.column1.y - m.column1.x * m.column0.y; }
constexpr float determinant(mat3 m) { return dot(m.column0, cross(m.column1, m.column2)); }
constexpr mat2 inverse(mat2 m) { return mat2({m.column1.y, -m.column0.y}, {-m.column1.x, m.column0.x}) / determinant(m); }
constexpr mat3 inverse(mat3 m) {
  return transpose(mat3(cross(m.column1, m.column2), cross(m.column2, m.column0), cross(m.column0, m.column1))) / determinant(m);
}
// By the twelve determinants of two rows (Laplace).
constexpr float minor__(vec4 a, vec4 b, int i, int j) { return a[i] * b[j] - b[i] * a[j]; }
constexpr float determinant(mat4 m) {
  const vec4 a = m.column0, b = m.column1, c = m.column2, d = m.column3;
  return minor__(a, b, 0, 1) * minor__(c, d, 2, 3) - minor__(a, b, 0, 2) * minor__(c, d, 1, 3) + minor__(a, b, 0, 3) * minor__(c, d, 1, 2) +
         minor__(a, b, 1, 2) * minor__(c, d, 0, 3) - minor__(a, b, 1, 3) * minor__(c, d, 0, 2) + minor__(a, b, 2, 3) * minor__(c, d, 0, 1);
}
// Orthogonal to three vectors, by the determinant of each with them.
constexpr vec4 across__(vec4 a, vec4 b, vec4 c) {
  const mat4 basis(1.0f);
  return {determinant(mat4(basis[0], a, b, c)), determinant(mat4(basis[1], a, b, c)), determinant(mat4(basis[2], a, b, c)),
          determinant(mat4(basis[3], a, b, c))};
}
constexpr mat4 inverse(mat4 m) {
  const vec4 a = m.column0, b = m.column1, c = m.column2, d = m.column3;
  return transpose(mat4(across__(b, c, d), -across__(a, c, d), across__(a, b, d), -across__(a, b, c))) / determinant(m);
}
