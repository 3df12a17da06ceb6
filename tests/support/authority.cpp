#include "tests/support/authority.h"

#include <fstream>
#include <stdexcept>

namespace ridgecast::testing_support {

void Authority::run(std::vector<std::string> arguments) const {
  arguments.insert(arguments.begin(), "openssl");
  const Finished finished = runProgram(arguments);
  if (finished.code != 0) throw std::runtime_error("openssl failed: " + finished.output);
}

Authority::Authority() {
  run({"req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", (folder_ / "ca.key").string(),
       "-out", certificate(), "-subj", "/CN=Test authority", "-days", "2"});
}

Authority::Issued Authority::issue(const std::string& names, int days) {
  const std::string name = "server" + std::to_string(++issued_);
  const Issued issued{(folder_ / (name + ".pem")).string(), (folder_ / (name + ".key")).string()};
  const std::string request = (folder_ / (name + ".csr")).string(), extensions = (folder_ / (name + ".ext")).string();
  std::ofstream(extensions) << "subjectAltName=" << names << "\n";
  run({"req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", issued.key, "-out", request, "-subj",
       "/CN=" + name});
  run({"x509", "-req", "-in", request, "-CA", certificate(), "-CAkey", (folder_ / "ca.key").string(), "-out", issued.certificate, "-days",
       std::to_string(days), "-extfile", extensions});
  return issued;
}

}  // namespace ridgecast::testing_support
