// Arrays of plain values on 64-byte boundaries (a cache line, the widest vector). Large arrays are
// zeroed by the operating system on first touch, and ask for huge pages where those exist.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

namespace nerf {

namespace internal {
void* aligned_allocate_zeroed(size_t bytes);
void aligned_free(void* p, size_t bytes);
}  // namespace internal

template <class T>
class AlignedArray {
 public:
  AlignedArray() = default;
  explicit AlignedArray(size_t size)
      : data_(static_cast<T*>(internal::aligned_allocate_zeroed(size * sizeof(T)))), size_(size) {}
  ~AlignedArray() { internal::aligned_free(data_, size_ * sizeof(T)); }
  AlignedArray(AlignedArray&& o) noexcept
      : data_(std::exchange(o.data_, nullptr)), size_(std::exchange(o.size_, 0)) {}
  AlignedArray& operator=(AlignedArray&& o) noexcept {
    std::swap(data_, o.data_);
    std::swap(size_, o.size_);
    return *this;
  }
  AlignedArray(const AlignedArray& o) : AlignedArray(o.size_) {
    for (size_t i = 0; i < size_; ++i) data_[i] = o.data_[i];
  }
  AlignedArray& operator=(const AlignedArray& o) { return *this = AlignedArray(o); }

  T* data() { return data_; }
  const T* data() const { return data_; }
  size_t size() const { return size_; }
  T& operator[](size_t i) { return data_[i]; }
  const T& operator[](size_t i) const { return data_[i]; }
  std::span<T> span() { return {data_, size_}; }
  std::span<const T> span() const { return {data_, size_}; }
  T* begin() { return data_; }
  T* end() { return data_ + size_; }
  const T* begin() const { return data_; }
  const T* end() const { return data_ + size_; }

 private:
  T* data_ = nullptr;
  size_t size_ = 0;
};

}  // namespace nerf
