#pragma once
// How busy other programs kept the machine while something was measured: times are worth what this is low.

#include <optional>

namespace ridgecast::evaluation {

class Others {
 public:
  Others();  // begins now
  // The share, 0..1, of all processors' time since then that neither this process and its ended children had, nor nobody. Nothing: the
  // machine does not say (/proc/stat).
  std::optional<double> share() const;

 private:
  struct Times {
    double all = 0, busy = 0, own = 0;  // seconds
  };
  static std::optional<Times> now();
  std::optional<Times> began_;
};

}  // namespace ridgecast::evaluation
