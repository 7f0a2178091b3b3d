#include "nerf/base/file.h"

#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <numeric>
#include <thread>

#include "base/cgroup.h"
#include "nerf/base/memory.h"
#include "support/sanitizers.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using test::contains;
using test::error_of;

class FileTest : public ::testing::Test {
 protected:
  void TearDown() override {
    std::error_code ignored;
    fs::permissions(folder_, fs::perms::owner_all, ignored);
  }
  int files_in_folder() const {
    return static_cast<int>(
        std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }
  const test::TempFolder temporary_;
  const fs::path folder_ = temporary_.path();
};

// Runs `body` in a child process, so that limits and users can change there; true if it returned
// true. In a child no test assertion can be used.
template <class Body>
bool in_child(Body body) {
  const pid_t child = ::fork();
  if (child == 0) {
    bool good = false;
    try {
      good = body();
    } catch (const std::exception& error) {
      std::fprintf(stderr, "in the child: %s\n", error.what());
    }
    ::_exit(good ? 0 : 1);
  }
  int status = -1;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

TEST_F(FileTest, ReadsWhatWasWritten) {
  std::vector<uint8_t> bytes(300000);
  std::iota(bytes.begin(), bytes.end(), uint8_t{0});
  write_file_atomically(folder_ / "a.bin", bytes);
  EXPECT_EQ(read_file(folder_ / "a.bin"), bytes);
  write_file_atomically(folder_ / "a.bin", "short\n");
  EXPECT_EQ(read_text_file(folder_ / "a.bin"), "short\n");
  write_file_atomically(folder_ / "empty", "");
  EXPECT_TRUE(read_file(folder_ / "empty").empty());
  EXPECT_EQ(files_in_folder(), 2);
}

TEST_F(FileTest, ReadsFilesThatReportNoSize) {
  EXPECT_TRUE(contains(read_text_file("/proc/self/status"), "VmHWM"));
}

TEST_F(FileTest, UnreadablePathsAreErrorsThatSayWhy) {
  const std::string missing = error_of([&] { read_file(folder_ / "none"); });
  EXPECT_TRUE(contains(missing, "none: cannot open: No such file")) << missing;
  const std::string folder = error_of([&] { read_file(folder_); });
  EXPECT_TRUE(contains(folder, "this is a folder")) << folder;
  write_file_atomically(folder_ / "big", std::string(101, 'x'));
  const std::string big = error_of([&] { read_file(folder_ / "big", 100); });
  EXPECT_TRUE(contains(big, "101 bytes")) << big;
  EXPECT_EQ(read_file(folder_ / "big", 101).size(), 101u);
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  const std::string pipe = error_of([&] { read_file(folder_ / "pipe"); });
  EXPECT_TRUE(contains(pipe, "not a regular file")) << pipe;
}

TEST_F(FileTest, HugeSparseFileIsRefusedBeforeAllocation) {
  std::ofstream(folder_ / "sparse") << "x";
  fs::resize_file(folder_ / "sparse", uint64_t{1} << 40);
  const std::string error = error_of([&] { read_file(folder_ / "sparse"); });
  EXPECT_TRUE(contains(error, "1048576 MB")) << error;
}

// A file-size limit makes write() fail in the middle just as a full disk does.
TEST_F(FileTest, FailedWriteKeepsTheOldContentAndLeavesNothing) {
  write_file_atomically(folder_ / "model", "old");
  EXPECT_TRUE(in_child([&] {
    std::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{64 << 10, 64 << 10};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    const std::string error =
        error_of([&] { write_file_atomically(folder_ / "model", std::string(1 << 20, 'n')); });
    return contains(error, "model: cannot write: File too large") && contains(error, "ulimit -f");
  }));
  EXPECT_EQ(read_text_file(folder_ / "model"), "old");
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(FileTest, FullDiskHintNamesTheRemedy) {
  const Error error = errno_error(ENOSPC, "cannot write", "x/model");
  EXPECT_EQ(std::string(error.what()),
            "x/model: cannot write: No space left on device (free some space or choose a folder on "
            "another disk)");
}

TEST_F(FileTest, UnwritableFolderIsAnError) {
  write_file_atomically(folder_ / "model", "old");
  fs::permissions(folder_, fs::perms{0555});
  EXPECT_TRUE(in_child([&] {
    // Root ignores permissions: become somebody else.
    if (::geteuid() == 0 && ::setuid(65534) != 0) return false;
    const std::string write = error_of([&] { write_file_atomically(folder_ / "model", "new"); });
    const std::string make = error_of([&] { make_writable_folder(folder_); });
    const std::string below = error_of([&] { make_writable_folder(folder_ / "runs" / "1"); });
    return contains(write, "Permission denied") && contains(write, "ls -ld") &&
           contains(make, "cannot write into the folder") && contains(below, "cannot create");
  }));
  EXPECT_EQ(read_text_file(folder_ / "model"), "old");
}

TEST_F(FileTest, TargetsThatCannotBeReplaced) {
  fs::create_directory(folder_ / "sub");
  const std::string folder = error_of([&] { write_file_atomically(folder_ / "sub", "x"); });
  EXPECT_TRUE(contains(folder, "Is a directory")) << folder;
  const std::string none = error_of([&] { write_file_atomically(folder_ / "no" / "f", "x"); });
  EXPECT_TRUE(contains(none, "No such file")) << none;
  const std::string device = error_of([&] { write_file_atomically("/dev/full", "x"); });
  EXPECT_TRUE(contains(device, "not a regular file")) << device;
  const std::string slash = error_of([&] { write_file_atomically(folder_ / "sub" / "", "x"); });
  EXPECT_TRUE(contains(slash, "is not the name of a file")) << slash;
  const std::string longer =
      error_of([&] { write_file_atomically(folder_ / std::string(300, 'a'), "x"); });
  EXPECT_TRUE(contains(longer, "shorter name")) << longer;
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(FileTest, LongestPossibleNameWorks) {
  const fs::path path = folder_ / (std::string(251, 'a') + ".png");
  write_file_atomically(path, "x");
  EXPECT_EQ(read_text_file(path), "x");
}

TEST_F(FileTest, LinkStaysAndItsFileIsReplaced) {
  fs::create_directory(folder_ / "real");
  write_file_atomically(folder_ / "real" / "f", "old");
  fs::create_symlink("real/f", folder_ / "link");
  write_file_atomically(folder_ / "link", "new");
  EXPECT_TRUE(fs::is_symlink(folder_ / "link"));
  EXPECT_EQ(read_text_file(folder_ / "real" / "f"), "new");
}

TEST_F(FileTest, WriterWithAPathOfItsOwn) {
  const fs::path path = folder_ / "film.mp4";
  write_file_atomically(path, [&](const fs::path& temporary) {
    EXPECT_EQ(temporary.extension(), ".mp4");
    EXPECT_EQ(temporary.parent_path(), folder_);
    EXPECT_FALSE(fs::exists(path));
    fs::remove(temporary);  // some writers replace the file
    std::ofstream(temporary) << "frames";
  });
  EXPECT_EQ(read_text_file(path), "frames");
  EXPECT_THROW(write_file_atomically(path,
                                     [](const fs::path& temporary) {
                                       std::ofstream(temporary) << "half";
                                       throw Error("stopped");
                                     }),
               Error);
  const std::string nothing =
      error_of([&] { write_file_atomically(path, [](const fs::path&) {}); });
  EXPECT_TRUE(contains(nothing, "nothing was written")) << nothing;
  EXPECT_EQ(read_text_file(path), "frames");
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(FileTest, KilledWriterLeavesTheOldContentAndItsFileIsReused) {
  const fs::path path = folder_ / "model";
  write_file_atomically(path, "old");
  for (int i = 0; i < 3; ++i) {
    const pid_t child = ::fork();
    if (child == 0) {
      write_file_atomically(path, [](const fs::path& temporary) {
        std::ofstream(temporary) << "a half-written file";
        ::raise(SIGKILL);
      });
      ::_exit(0);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    EXPECT_EQ(read_text_file(path), "old");
  }
  EXPECT_EQ(files_in_folder(), 2);
  write_file_atomically(path, "new");
  EXPECT_EQ(read_text_file(path), "new");
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(FileTest, WritersOfOneNameDoNotMix) {
  const fs::path path = folder_ / "shared";
  std::vector<std::thread> writers;
  for (int w = 0; w < 4; ++w) {
    writers.emplace_back([&, w] {
      for (int i = 0; i < 25; ++i) {
        write_file_atomically(path, std::string(40000, static_cast<char>('a' + w)));
      }
    });
  }
  for (std::thread& writer : writers) writer.join();
  const std::string text = read_text_file(path);
  ASSERT_EQ(text.size(), 40000u);
  EXPECT_EQ(text, std::string(40000, text[0]));
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(FileTest, MakesFoldersAndLeavesThemEmpty) {
  make_writable_folder(folder_ / "a" / "b");
  make_writable_folder(folder_ / "a" / "b");
  EXPECT_TRUE(fs::is_empty(folder_ / "a" / "b"));
  write_file_atomically(folder_ / "file", "x");
  const std::string file = error_of([&] { make_writable_folder(folder_ / "file"); });
  EXPECT_TRUE(contains(file, "is a file where a folder is wanted")) << file;
  const std::string below = error_of([&] { make_writable_folder(folder_ / "file" / "sub"); });
  EXPECT_TRUE(contains(below, "Not a directory")) << below;
}

// The folders of a cgroup tree, as /sys/fs/cgroup shows them.
class CgroupTest : public FileTest {
 protected:
  void put(const fs::path& name, const std::string& text) {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name) << text;
  }
  std::optional<uint64_t> limit() {
    return internal::cgroup_memory_limit(folder_ / "self", folder_ / "mount");
  }
};

TEST_F(CgroupTest, Version2TakesTheSmallestOnTheWayUp) {
  put("self", "0::/pod/box\n");
  EXPECT_EQ(limit(), std::nullopt);
  put("mount/pod/box/memory.max", "max\n");
  EXPECT_EQ(limit(), std::nullopt);
  put("mount/pod/memory.max", "3000000\n");
  EXPECT_EQ(limit(), 3000000u);
  put("mount/pod/box/memory.high", "2000000\n");
  EXPECT_EQ(limit(), 2000000u);
}

TEST_F(CgroupTest, ContainerWhoseMountIsItsOwnGroup) {
  put("self", "0::/host/path/that/is/not/mounted\n");
  put("mount/memory.max", "1000000\n");
  EXPECT_EQ(limit(), 1000000u);
}

TEST_F(CgroupTest, Version1AndMixed) {
  put("self", "12:cpu,cpuacct:/a\n11:blkio,memory:/box\n1:name=systemd:/\n0::/\n");
  put("mount/memory/box/memory.limit_in_bytes", "5000000\n");
  put("mount/memory/memory.limit_in_bytes", "9223372036854771712\n");
  put("mount/memory.limit_in_bytes", "7\n");
  EXPECT_EQ(limit(), 5000000u);
}

TEST_F(CgroupTest, DamagedFilesLimitNothing) {
  put("self", "garbage\n::\n0:\n0::/../..\n");
  put("mount/memory.max", "12x\n");
  EXPECT_EQ(limit(), std::nullopt);
}

TEST_F(CgroupTest, ProcessorsOfEveryGroupOnTheWayUp) {
  const auto processors = [&] {
    return internal::cgroup_cpu_limit(folder_ / "self", folder_ / "mount");
  };
  put("self", "0::/system.slice/box\n");
  put("mount/system.slice/box/cpu.max", "max 100000\n");
  EXPECT_EQ(processors(), std::nullopt);
  put("mount/system.slice/cpu.max", "250000 100000\n");
  EXPECT_EQ(processors(), 3);
  put("mount/cpu.max", "1000 100000\n");
  EXPECT_EQ(processors(), 1);
  put("self", "3:cpu,cpuacct:/box\n");
  put("mount/cpu/box/cpu.cfs_quota_us", "-1\n");
  put("mount/cpu/box/cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(processors(), std::nullopt);
  put("mount/cpu/cpu.cfs_quota_us", "400000\n");
  put("mount/cpu/cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(processors(), 4);
}

TEST(Memory, LimitsAndPeakAreSensible) {
  EXPECT_GT(available_memory_bytes(), uint64_t{64} << 20);
  EXPECT_LT(available_memory_bytes(), uint64_t{1} << 50);
  EXPECT_TRUE(in_child([] {
    const uint64_t before = peak_memory_bytes();
    std::vector<char> block(64 << 20, 1);
    // What nobody may look at a compiler need not write.
    [[maybe_unused]] char* const volatile seen = block.data();
    const uint64_t after = peak_memory_bytes();
    return before > (1 << 20) && after >= before + (60 << 20) && block[12345] == 1;
  }));
#ifndef NERF_SANITIZED  // they reserve more address space than the limit leaves
  EXPECT_TRUE(in_child([] {
    const rlimit limit{uint64_t{1} << 34, uint64_t{1} << 34};
    return ::setrlimit(RLIMIT_AS, &limit) == 0 && available_memory_bytes() <= limit.rlim_cur;
  }));
#endif
}

}  // namespace
}  // namespace nerf
