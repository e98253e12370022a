// Walks over a robot's tree. UNROLLED: every index is a compile-time constant, so table entries become immediates,
// zeros of the factor are skipped and intermediates stay in registers. Too few threads run at a time to hide the
// latency of index loads. Larger robots, with too long a text, have plain loops. An index is an At or an int.

template <int N> struct At {
    static constexpr int n = N;
    constexpr operator int() const { return N; }
};

template <int I, int TO, class F> FN void rise(const F& f) {
    if constexpr (I < TO) { f(At<I>()); rise<I + 1, TO>(f); }
}
template <int I, int FROM, class F> FN void fall(const F& f) {
    if constexpr (I >= FROM) { f(At<I>()); fall<I - 1, FROM>(f); }
}
template <int I, class F> FN void climb(const F& f) {
    if constexpr (I >= 0) { f(At<I>()); climb<ABOVE[I]>(f); }
}
template <int I, class F> FN void ascend(const F& f) {
    if constexpr (I >= 0) { f(At<I>()); ascend<PARENT[I]>(f); }
}

// Calls f for FROM to TO - 1: ascending, and (backward) descending.
template <int FROM, int TO, bool AS_TEXT = UNROLLED, class F> FN void for_up(const F& f) {
    if constexpr (AS_TEXT) rise<FROM, TO>(f);
    else for (int i = FROM; i < TO; i++) f(i);
}
template <int FROM, int TO, bool AS_TEXT = UNROLLED, class F> FN void backward(const F& f) {
    if constexpr (AS_TEXT) fall<TO - 1, FROM>(f);
    else for (int i = TO - 1; i >= FROM; i--) f(i);
}

// Calls f for the DoFs above k in the tree; for k and those above (upward).
template <int K, class F> FN void above(At<K>, const F& f) { climb<ABOVE[K]>(f); }
template <class F> FN void above(int k, const F& f) { for (int i = ABOVE[k]; i >= 0; i = ABOVE[i]) f(i); }
template <class K, class F> FN void upward(K k, const F& f) {
    f(k);
    above(k, f);
}

// Calls f for the links above i in the tree; for i and those above (for_ancestors).
template <int I, class F> FN void forebears(At<I>, const F& f) { ascend<PARENT[I]>(f); }
template <class F> FN void forebears(int i, const F& f) { for (int k = PARENT[i]; k >= 0; k = PARENT[k]) f(k); }
template <class I, class F> FN void for_ancestors(I i, const F& f) {
    f(i);
    forebears(i, f);
}

// Last DoF that moves a link; the link's other DoFs are above it.
constexpr int last_dof(int link) {
    int last = -1;
    for (int i = link; i >= 0; i = PARENT[i]) {
        const int own = DOFS && i == 0 ? DOFS - 1 : DOF[i];
        if (own > last) last = own;
    }
    return last;
}
template <int I> FN At<last_dof(I)> last_dof(At<I>) { return At<last_dof(I)>(); }

constexpr bool pointed(int link) {
    for (int p = 0; p < NP; p++) if (POINT_LINK[p] == link) return true;
    return false;
}
