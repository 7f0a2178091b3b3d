#include "nerf/base/file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstring>
#include <system_error>
#include <utility>

namespace nerf {
namespace {

namespace fs = std::filesystem;

class Fd {
 public:
  explicit Fd(int fd = -1) : fd_(fd) {}
  Fd(Fd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Fd& operator=(Fd&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Fd() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }
  // Closing can report a failed write (network file systems), so the caller may want its result.
  int close() { return ::close(std::exchange(fd_, -1)); }

 private:
  int fd_;
};

int open_retry(const fs::path& path, int flags, mode_t mode = 0) {
  int fd;
  do {
    fd = ::open(path.c_str(), flags | O_CLOEXEC, mode);
  } while (fd < 0 && errno == EINTR);
  return fd;
}

std::string size_text(uint64_t bytes) {
  if (bytes < (1u << 20)) return std::to_string(bytes) + " bytes";
  return std::to_string(bytes >> 20) + " MB";
}

// Opens for reading and checks that it is a regular file of at most max_bytes; returns its size.
Fd open_regular(const fs::path& path, uint64_t max_bytes, uint64_t* size) {
  // O_NONBLOCK: opening a named pipe would otherwise wait for a writer for ever.
  Fd fd(open_retry(path, O_RDONLY | O_NONBLOCK));
  if (fd.get() < 0) throw errno_error(errno, "cannot open", path);
  struct stat info;
  if (::fstat(fd.get(), &info) != 0) throw errno_error(errno, "cannot read", path);
  if (S_ISDIR(info.st_mode)) throw errno_error(EISDIR, "cannot read", path);
  if (!S_ISREG(info.st_mode)) {
    throw Error("is not a regular file", path.string(), "give the path of an ordinary file");
  }
  *size = static_cast<uint64_t>(info.st_size);
  if (*size > max_bytes) {
    throw Error("is " + size_text(*size) + " long, more than the " + size_text(max_bytes) +
                    " that such a file may have",
                path.string(), "check that this is the right file");
  }
  return fd;
}

template <class Buffer>
Buffer read_whole(const fs::path& path, uint64_t max_bytes) {
  uint64_t expected = 0;
  const Fd fd = open_regular(path, max_bytes, &expected);
  Buffer buffer;
  try {
    buffer.resize(std::min(max_bytes, expected + 1));  // growing at the end would hold it twice
  } catch (const std::bad_alloc&) {
    throw Error("not enough memory to read " + size_text(expected), path.string());
  }
  uint64_t done = 0;
  for (;;) {
    if (done == buffer.size()) {
      // Files of /proc report a size of 0, and a file may grow while it is read.
      if (done >= max_bytes) break;
      buffer.resize(std::min<uint64_t>(max_bytes, done + 4096));
    }
    const ssize_t n = ::read(fd.get(), buffer.data() + done, buffer.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw errno_error(errno, "cannot read", path);
    if (n == 0) break;
    done += static_cast<uint64_t>(n);
  }
  buffer.resize(done);
  return buffer;
}

void write_all(int fd, std::span<const uint8_t> bytes, const fs::path& shown) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), std::min<size_t>(bytes.size(), 1u << 30));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw errno_error(errno, "cannot write", shown);
    bytes = bytes.subspan(static_cast<size_t>(n));
  }
}

fs::path folder_of(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

// Hidden, with the final extension kept last (writers choose their format by it), and short enough
// for the file system however long the final name is.
fs::path temporary_name(const fs::path& path, const std::string& slot) {
  const std::string extension = path.extension().string();
  std::string stem = path.stem().string();
  const std::string tail = ".tmp" + slot + extension;
  const size_t room = NAME_MAX > tail.size() + 1 ? NAME_MAX - tail.size() - 1 : 0;
  if (stem.size() > room) stem.resize(room);
  return folder_of(path) / ("." + stem + tail);
}

// The temporary file of one atomic write; removed unless commit() succeeded.
//
// Names are tried in order, and the writer of a name holds a lock on it. So a name whose lock is
// free was left by a killed process and is taken over: crashes leave no growing heap of files.
class TemporaryFile {
 public:
  explicit TemporaryFile(const fs::path& target) : target_(target) {
    for (int slot = 0; slot < 1000 && locks_work_; ++slot) {
      path_ = temporary_name(target, slot == 0 ? "" : std::to_string(slot));
      if (try_take(O_CREAT)) return;
    }
    static std::atomic<uint64_t> counter{0};
    path_ = temporary_name(target, std::to_string(::getpid()) + "-" + std::to_string(counter++));
    if (!try_take(O_CREAT | O_EXCL)) throw errno_error(EBUSY, "cannot create", path_);
  }
  ~TemporaryFile() {
    if (!committed_) ::unlink(path_.c_str());
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  const fs::path& path() const { return path_; }
  int fd() const { return fd_.get(); }

  // Syncs, renames to the target, syncs the folder.
  void commit() {
    {
      // By path: a writer of its own may have replaced the file instead of overwriting it.
      Fd file(open_retry(path_, O_RDONLY));
      if (file.get() < 0) throw errno_error(errno, "cannot write", target_);
      if (::fsync(file.get()) != 0) throw errno_error(errno, "cannot write", target_);
    }
    if (::rename(path_.c_str(), target_.c_str()) != 0) {
      throw errno_error(errno, "cannot write", target_);
    }
    committed_ = true;
    if (fd_.close() != 0) throw errno_error(errno, "cannot write", target_);
    const Fd folder(open_retry(folder_of(target_), O_RDONLY | O_DIRECTORY));
    // Some file systems cannot sync a folder (EINVAL); the rename has happened all the same.
    if (folder.get() >= 0 && ::fsync(folder.get()) != 0 && errno == EIO) {
      throw errno_error(EIO, "cannot write", target_);
    }
  }

 private:
  bool try_take(int flags) {
    Fd fd(open_retry(path_, O_RDWR | O_NOFOLLOW | flags, 0666));
    if (fd.get() < 0) {
      // A name in use by another user, or a link: the next name. Otherwise the folder is at fault.
      struct stat info;
      const int code = errno;
      if ((flags & O_EXCL) == 0 && ::lstat(path_.c_str(), &info) == 0) return false;
      throw errno_error(code, "cannot write", target_);
    }
    if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
      if (errno == EWOULDBLOCK) return false;
      // A file system without locks: only a name that nobody else can have is safe.
      if (std::exchange(locks_work_, false)) ::unlink(path_.c_str());
      if ((flags & O_EXCL) == 0) return false;
    }
    // Between open and flock the former owner may have renamed the file to its final name.
    struct stat by_fd, by_name;
    if (::fstat(fd.get(), &by_fd) != 0 || ::lstat(path_.c_str(), &by_name) != 0 ||
        by_fd.st_ino != by_name.st_ino || by_fd.st_dev != by_name.st_dev ||
        !S_ISREG(by_fd.st_mode)) {
      return false;
    }
    if (by_fd.st_size != 0 && ::ftruncate(fd.get(), 0) != 0) return false;
    fd_ = std::move(fd);
    return true;
  }

  fs::path target_, path_;
  Fd fd_;
  bool locks_work_ = true;
  bool committed_ = false;
};

// Follows links to the file that will be replaced, and refuses what cannot be.
fs::path resolve_target(const fs::path& path) {
  if (path.filename().empty()) {
    throw Error("is not the name of a file", path.string(), "give a file name after the folder");
  }
  std::error_code failed;
  const fs::path target = fs::is_symlink(path, failed) ? fs::weakly_canonical(path, failed) : path;
  if (failed) return path;
  const fs::file_status status = fs::status(target, failed);  // what fails here fails below too
  if (fs::is_directory(status)) throw errno_error(EISDIR, "cannot write", path);
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    throw Error("cannot write: not a regular file", path.string(), "choose another name");
  }
  return target;
}

}  // namespace

Error errno_error(int code, const std::string& what, const fs::path& path) {
  std::string hint;
  switch (code) {
    case ENOSPC:
    case EDQUOT:
      hint = "free some space or choose a folder on another disk";
      break;
    case EFBIG:
      hint = "the file would exceed this system's file-size limit; see ulimit -f";
      break;
    case EACCES:
    case EPERM:
      hint = "check who owns it with ls -ld, or choose another place";
      break;
    case EROFS:
      hint = "choose a folder on a disk that is mounted for writing";
      break;
    case EISDIR:
      hint = "this is a folder; give the path of a file";
      break;
    case ENOTDIR:
      hint = "a part of the path before the last is a file, not a folder";
      break;
    case ENOENT:
      hint = "check the path; a part of it does not exist";
      break;
    case ENAMETOOLONG:
      hint = "choose a shorter name";
      break;
    case EMFILE:
    case ENFILE:
      hint = "too many files are open; see ulimit -n";
      break;
    case EIO:
      hint = "the disk reports a fault; check it before going on";
      break;
    default:
      break;
  }
  return Error(what + ": " + std::generic_category().message(code), path.string(), hint);
}

std::vector<uint8_t> read_file(const fs::path& path, uint64_t max_bytes) {
  return read_whole<std::vector<uint8_t>>(path, max_bytes);
}

std::string read_text_file(const fs::path& path, uint64_t max_bytes) {
  return read_whole<std::string>(path, max_bytes);
}

void write_file_atomically(const fs::path& path, std::span<const uint8_t> bytes) {
  TemporaryFile temporary(resolve_target(path));
  write_all(temporary.fd(), bytes, path);
  temporary.commit();
}

void write_file_atomically(const fs::path& path, std::string_view text) {
  write_file_atomically(path,
                        std::span(reinterpret_cast<const uint8_t*>(text.data()), text.size()));
}

void write_file_atomically(const fs::path& path,
                           const std::function<void(const fs::path&)>& write) {
  TemporaryFile temporary(resolve_target(path));
  write(temporary.path());
  struct stat info;
  if (::stat(temporary.path().c_str(), &info) != 0 || info.st_size == 0) {
    throw Error("nothing was written", path.string(), "check that the disk is not full");
  }
  temporary.commit();
}

void make_writable_folder(const fs::path& folder) {
  if (folder.empty()) throw Error("the name of a folder is empty");
  std::error_code failed;
  fs::create_directories(folder, failed);
  std::error_code unknown;
  if (!fs::is_directory(folder, unknown)) {
    if (!failed || fs::exists(folder, unknown)) {
      throw Error("is a file where a folder is wanted", folder.string(),
                  "remove it or choose another name");
    }
    throw errno_error(failed.value(), "cannot create the folder", folder);
  }
  // Only an attempt tells: permission bits say nothing of read-only mounts, quotas or root.
  std::string probe = (folder / ".write-test-XXXXXX").string();
  const Fd fd(::mkostemp(probe.data(), O_CLOEXEC));
  if (fd.get() < 0) throw errno_error(errno, "cannot write into the folder", folder);
  ::unlink(probe.c_str());
}

}  // namespace nerf
