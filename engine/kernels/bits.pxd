# Types with which Cython compiles bits.py. Its meaning is written there.
import cython

@cython.locals(found=list, row=bytes, place=int, position=int, byte="unsigned char")
cpdef list indices(object bits)
