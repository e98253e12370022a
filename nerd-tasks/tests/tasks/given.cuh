// What programs of a task's text are given, from standard input.

#include <cstdio>
template <typename T> T* take_in(long long n) {
    T* all = new T[n + 1]();
    if ((long long)std::fread(all, sizeof(T), n, stdin) != n) throw 1;
    return all;
}
