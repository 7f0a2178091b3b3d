// Two kinds of failure. A user's mistake (a broken file, a wrong option) throws Error with what
// went wrong, where, and what to do about it; only main() catches it. A bug is a failed NERF_CHECK,
// which throws std::logic_error naming the expression and both values.
#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

namespace nerf {

// `where` names the file (with line or byte offset) or the option; `hint` says what to do. Either
// may be empty. what() is the one line "where: what (hint)".
class Error : public std::runtime_error {
 public:
  Error(const std::string& what, const std::string& where = "", const std::string& hint = "")
      : std::runtime_error((where.empty() ? "" : where + ": ") + what +
                           (hint.empty() ? "" : " (" + hint + ")")),
        message_(what),
        where_(where),
        hint_(hint) {}

  const std::string& message() const { return message_; }
  const std::string& where() const { return where_; }
  const std::string& hint() const { return hint_; }

 private:
  std::string message_, where_, hint_;
};

// The work was stopped by the caller's Cancel; state is as after the last whole step.
class Cancelled : public std::runtime_error {
 public:
  Cancelled() : std::runtime_error("cancelled") {}
};

namespace internal {
[[noreturn]] void check_failed(const char* file, int line, const char* expression,
                               const std::string& values);
template <class A, class B>
std::string both_values(const A& a, const B& b) {
  std::ostringstream s;
  s << a << " vs " << b;
  return s.str();
}
}  // namespace internal

}  // namespace nerf

// Without the folder, so that no object file depends on where the sources lie.
#define NERF_CHECK(condition)                                                                  \
  do {                                                                                         \
    if (!(condition)) ::nerf::internal::check_failed(__FILE_NAME__, __LINE__, #condition, ""); \
  } while (0)
#define NERF_CHECK_OP(a, op, b)                                                        \
  do {                                                                                 \
    const auto& check_a = (a);                                                         \
    const auto& check_b = (b);                                                         \
    if (!(check_a op check_b))                                                         \
      ::nerf::internal::check_failed(__FILE_NAME__, __LINE__, #a " " #op " " #b,       \
                                     ::nerf::internal::both_values(check_a, check_b)); \
  } while (0)
#define NERF_CHECK_EQ(a, b) NERF_CHECK_OP(a, ==, b)
#define NERF_CHECK_LE(a, b) NERF_CHECK_OP(a, <=, b)
#define NERF_CHECK_LT(a, b) NERF_CHECK_OP(a, <, b)
#define NERF_CHECK_GE(a, b) NERF_CHECK_OP(a, >=, b)
#define NERF_CHECK_GT(a, b) NERF_CHECK_OP(a, >, b)
